"""The page in a real browser."""

import os
import shutil
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

CHROMIUM = shutil.which("chromium")
_SILENT = [
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync",
    "--disable-background-networking", "--disable-component-update",
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",  # the network is cut
]  # fmt: skip
PATIENCE_MS = 300_000  # on a busy machine; nothing waits so long on an idle one


@dataclass(frozen=True)
class Served:
    """The command at work. temporary: where its files are."""

    url: str
    temporary: Path


@contextmanager
def serve(temporary: Path, *options: str) -> Iterator[Served]:
    """`steered-marigold app`, which can reach no other machine; its files lie in `temporary`."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    asked = temporary / "asked.txt"
    command = [sys.executable, "-m", "tests.app.offline", str(asked), "app", "--port", str(port)]
    with subprocess.Popen(
        [*command, *options],
        env={**os.environ, "TMPDIR": str(temporary)},
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        try:
            line = process.stdout.readline()
            assert line.startswith("ready: ")
            yield Served(line.removeprefix("ready: ").strip(), temporary)
        finally:
            process.terminate()
        assert process.wait(120) == 0
    assert not list(temporary.glob("steered-marigold-*"))  # nothing is left behind
    assert not asked.exists(), asked.read_text()


@pytest.fixture(scope="session")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """The page, with small limits and a folder of its own disk."""
    from tests.app.test_inputs import write_frame

    root = tmp_path_factory.mktemp("root")
    write_frame(root / "kitchen", "f1", (96, 128))
    limits = ["--max-upload", "1", "--max-megapixels", "0.5", "--max-seconds", "3000"]
    with serve(tmp_path_factory.mktemp("tmp"), "--root", str(root), *limits) as page:
        yield page


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """Chromium, without a window."""
    if CHROMIUM is None:
        pytest.skip("there is no chromium on this machine")
    playwright = pytest.importorskip("playwright.sync_api")
    with playwright.sync_playwright() as tools:
        chromium = tools.chromium.launch(executable_path=CHROMIUM, args=_SILENT)
        yield chromium
        chromium.close()


class Visitor:
    """Someone at the page, and what the page asked for and complained of meanwhile."""

    def __init__(self, browser: Any, url: str, *, width: int = 1400) -> None:
        self.context = browser.new_context(viewport={"width": width, "height": 900})
        self.page = self.context.new_page()
        self.page.set_default_timeout(PATIENCE_MS)
        self.requests: list[str] = []
        self.errors: list[str] = []
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.goto(url)
        self.page.wait_for_selector(".viewer .empty")

    def open_sample(self, name: str) -> None:
        self.page.get_by_role("button", name=name).click()
        self.page.wait_for_selector(".viewer[data-ready]")

    def complete(self) -> str:
        """The facts of the result."""
        self.page.get_by_role("button", name="Complete", exact=True).click()
        return self.facts()

    def facts(self) -> str:
        """What the page says of the result, once it has one."""
        self.page.wait_for_selector("#facts li")
        return str(self.page.inner_text("#facts"))

    def tab(self, name: str) -> None:
        self.page.get_by_role("tab", name=name).click()

    def message(self) -> str:
        """The error on the page, once there is one."""
        self.page.wait_for_selector(".box.error")
        return str(self.page.inner_text(".box.error"))

    def hover(self, stage: int, across: float, down: float) -> str:
        """What is read with the pointer at a place of a picture, in shares of its size."""
        place = self.page.locator(".viewer .stage").nth(stage)
        place.scroll_into_view_if_needed()
        box = place.bounding_box()
        self.page.mouse.move(box["x"] + across * box["width"], box["y"] + down * box["height"])
        return str(self.page.inner_text(".viewer .readout"))


@pytest.fixture
def visit(browser: Any, served: Served) -> Iterator[Any]:
    """Opens the page, for as many visitors as are asked for."""
    visitors: list[Visitor] = []

    def arrive(**how: Any) -> Visitor:
        visitors.append(Visitor(browser, served.url, **how))
        return visitors[-1]

    yield arrive
    for visitor in visitors:
        visitor.context.close()
        assert not visitor.errors
        assert all(url.startswith((served.url, "data:", "blob:")) for url in visitor.requests)
