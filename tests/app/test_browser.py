"""What people do at the page, in Chromium. Every visit also asserts that no other host is asked."""

import json
import re
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from io import BytesIO
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
import pytest
from PIL import Image

from steered_marigold.io.depth_maps import read_depth
from steered_marigold.io.point_clouds import read_point_cloud
from tests.app.conftest import PATIENCE_MS, Served, Visitor, serve
from tests.app.test_inputs import write_frame

pytestmark = pytest.mark.browser
Visit = Callable[..., Visitor]


def test_a_sample_is_completed_and_its_depth_is_read_with_pointer_and_keys(visit: Visit) -> None:
    visitor = visit()
    visitor.open_sample("Room")
    assert "uint16" in visitor.page.inner_text("#source")
    assert "if millimetres" in visitor.page.inner_text("#source")
    assert re.fullmatch(r"x \d+, y \d+ · measured \d\.\d+ m", visitor.hover(1, 0.9, 0.9))
    facts = visitor.complete()
    assert "preset fast" in facts
    assert re.search(r"Depth from \d+\.\d+ to \d+\.\d+ m", facts)
    titles = visitor.page.locator(".viewer figcaption").all_inner_texts()
    assert [title.split(",")[0] for title in titles] == ["Image", "Input", "Result", "Uncertainty"]
    assert visitor.page.locator(".viewer .quantity").all_inner_texts() == [
        "depth in metres", "depth in metres", "standard deviation in metres"
    ]  # fmt: skip
    pattern = r"x \d+, y \d+ · (not )?measured.* · result \d+\.\d+ m ± \d\.\d+ m"
    assert re.fullmatch(pattern, visitor.hover(2, 0.5, 0.1))
    before = visitor.page.inner_text(".viewer .readout")
    visitor.page.locator(".viewer .stage").nth(2).press("ArrowRight")
    after = visitor.page.inner_text(".viewer .readout")
    assert int(re.findall(r"\d+", after)[0]) == int(re.findall(r"\d+", before)[0]) + 4
    visitor.page.get_by_role("button", name="Slider", exact=True).click()
    cut = "getComputedStyle(document.querySelector('.viewer .front')).clipPath"
    half = visitor.page.evaluate(cut)
    visitor.page.get_by_label("Between input and result").press("End")
    assert visitor.page.evaluate(cut) != half


def test_a_hole_is_drawn_and_the_error_in_it_told(visit: Visit) -> None:
    visitor = visit()
    visitor.open_sample("Office")
    visitor.tab("Draw a hole")
    canvas = visitor.page.locator(".hole canvas")
    canvas.wait_for()
    visitor.page.click("#erase")
    assert visitor.message().startswith("Nothing is painted yet")
    box = canvas.bounding_box()
    assert box is not None
    visitor.page.mouse.move(box["x"] + 0.4 * box["width"], box["y"] + 0.8 * box["height"])
    visitor.page.mouse.down()
    visitor.page.mouse.move(box["x"] + 0.6 * box["width"], box["y"] + 0.85 * box["height"], steps=4)
    visitor.page.mouse.up()
    visitor.page.click("#erase")
    visitor.page.wait_for_selector(".box.hole")
    said = visitor.page.inner_text(".box.hole")
    found = re.search(r"In the ([\d,]+) erased pixels .* off by (\d\.\d+) m on average", said)
    assert found is not None
    assert int(found[1].replace(",", "")) > 1000
    assert float(found[2]) < 1
    assert visitor.page.locator(".box.error").count() == 0
    assert "Error in the hole" in visitor.page.locator(".viewer figcaption").all_inner_texts()
    assert re.search(r"erased: was \d\.\d+ m, off by \d\.\d+ m", visitor.hover(2, 0.5, 0.825))
    visitor.tab("Draw a hole")
    visitor.page.click("#restore")
    visitor.page.wait_for_selector(".box.hole", state="detached")


def test_the_scene_turns(visit: Visit) -> None:
    visitor = visit()
    visitor.open_sample("LiDAR lines")
    visitor.complete()
    visitor.tab("3D")
    scene = visitor.page.locator("#scene canvas")
    scene.wait_for()
    scene.scroll_into_view_if_needed()
    box = scene.bounding_box()
    assert box is not None

    def once(seen: Callable[[np.ndarray], bool]) -> np.ndarray:
        """The scene, once it is as it should be; drawn without a GPU it takes its time."""
        for _ in range(PATIENCE_MS // 500):
            shot = Image.open(BytesIO(visitor.page.screenshot(clip=box)))
            colours = np.asarray(shot.convert("RGB"), np.float32)
            if seen(colours):
                return colours
            visitor.page.wait_for_timeout(500)
        pytest.fail("the scene is not shown")

    shown = once(lambda colours: bool(colours.std() > 10))  # more than a background
    visitor.page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    visitor.page.mouse.down()
    visitor.page.mouse.move(
        box["x"] + box["width"] / 2 + 160, box["y"] + box["height"] / 2, steps=5
    )
    visitor.page.mouse.up()
    once(lambda colours: bool(np.abs(colours - shown).mean() > 1))


def test_downloads_hold_what_was_shown(visit: Visit, tmp_path: Path) -> None:
    visitor = visit()
    visitor.open_sample("Room")
    visitor.complete()
    shown = re.search(r"x (\d+), y (\d+) .* result (\S+) m", visitor.hover(2, 0.5, 0.5))
    assert shown is not None
    visitor.tab("Downloads")
    files = {}
    for kind in ("depth-png", "depth-npy", "depth-exr", "uncertainty", "cloud", "record"):
        visitor.page.wait_for_selector(f"#get-{kind}:not([disabled])")
        with visitor.page.expect_download() as download:
            visitor.page.click(f"#get-{kind}")
        files[kind] = tmp_path / download.value.suggested_filename
        download.value.save_as(files[kind])
    depth = np.load(files["depth-npy"])
    assert depth.shape == (480, 640)
    assert depth[int(shown[2]), int(shown[1])] == pytest.approx(float(shown[3]), abs=0.006)
    np.testing.assert_allclose(read_depth(files["depth-png"]).depth, depth, atol=0.00051)
    np.testing.assert_array_equal(read_depth(files["depth-exr"]).depth, depth)
    sigma = np.load(files["uncertainty"])
    assert sigma.min() >= 0
    assert sigma.max() > 0.01
    assert len(read_point_cloud(files["cloud"]).points) == depth.size
    record = json.loads(files["record"].read_text())
    assert record["preset"] == "fast"
    assert record["depth_max_m"] == pytest.approx(depth.max())


def test_own_files_are_read_and_reread(visit: Visit, tmp_path: Path) -> None:
    files = write_frame(tmp_path, "mine", (96, 128))
    visitor = visit()
    visitor.tab("Your files")
    visitor.page.set_input_files("#depth-file input[type=file]", files.depth)
    visitor.page.get_by_text("Now choose the image").wait_for()
    visitor.page.set_input_files("#image-file input[type=file]", files.image)
    visitor.page.get_by_text("uint16, 1.3 to 2.0 m if millimetres").wait_for()
    visitor.page.get_by_role("button", name="How depth is read").click()
    visitor.page.get_by_label("Depth scale").fill("0.01")
    visitor.page.click("#read-again")
    visitor.page.get_by_text("13.3 to 20.0 m if one unit is 0.01 m").wait_for()
    farthest = re.search(r" to (\d+\.\d+) m", visitor.complete())
    assert farthest is not None
    assert 15 < float(farthest[1]) < 30


def test_files_that_cannot_be_used_are_named(visit: Visit, tmp_path: Path) -> None:
    visitor = visit()
    visitor.tab("Your files")
    (tmp_path / "broken.png").write_text("no picture")
    visitor.page.set_input_files("#image-file input[type=file]", tmp_path / "broken.png")
    said = visitor.message()  # where it lies on the server is nobody's business
    assert said == "broken.png: damaged, or not of its kind (no known format of images)"
    Image.new("RGB", (1000, 600)).save(tmp_path / "large.png")
    visitor.page.get_by_label("Clear").first.click()
    visitor.page.set_input_files("#image-file input[type=file]", tmp_path / "large.png")
    visitor.page.get_by_text("The image has 0.6 megapixels").wait_for()
    (tmp_path / "heavy.npy").write_bytes(b"0" * 1_100_000)
    visitor.page.set_input_files("#depth-file input[type=file]", tmp_path / "heavy.npy")
    visitor.page.get_by_text('exceed the maximum allowed size of 1.0 Mb: "heavy.npy"').wait_for()


def test_a_frame_on_the_servers_disk_is_opened(visit: Visit) -> None:
    visitor = visit()
    visitor.tab("On the server")
    for label, choice in (
        ("Images, or a recording", "kitchen/images"),
        ("Depth maps", "kitchen/depths"),
        ("Frame", "f1"),
    ):
        visitor.page.get_by_label(label, exact=True).click()
        visitor.page.get_by_role("option", name=choice, exact=True).last.click()
    visitor.page.wait_for_selector(".viewer[data-ready]")
    assert "uint16" in visitor.page.inner_text("#source")


def test_a_run_is_cancelled_and_another_one_starts(visit: Visit) -> None:
    visitor = visit()
    visitor.open_sample("Room")
    visitor.tab("The method")
    visitor.page.click("#method-start")
    visitor.page.wait_for_selector("#cancel:not([disabled])")
    visitor.page.get_by_text(re.compile(r"\d+/100 steps")).wait_for()
    visitor.page.click("#cancel")
    assert visitor.message() == "Cancelled."
    visitor.page.wait_for_selector("#complete:not([disabled])")
    assert "preset fast" in visitor.complete()


def test_two_visitors_do_not_meet(visit: Visit, served: Served) -> None:
    first, second = visit(), visit()
    first.open_sample("Room")
    second.open_sample("Office")
    for visitor in (first, second):
        visitor.page.get_by_role("button", name="Complete", exact=True).click()
    shares = [re.search(r"([\d.]+)% of the pixels", v.facts()) for v in (first, second)]
    assert all(shares)
    assert shares[0][1] != shares[1][1]  # type: ignore[index]
    folders = set((served.temporary).glob("steered-marigold-*/sessions/*"))
    second.context.close()
    deadline = time.monotonic() + 30
    while set(served.temporary.glob("steered-marigold-*/sessions/*")) == folders:
        assert time.monotonic() < deadline, "the files of a visitor who left are still there"
        time.sleep(0.2)
    first.tab("Downloads")
    first.page.wait_for_selector("#get-record:not([disabled])")


def test_the_keyboard_is_enough(visit: Visit) -> None:
    visitor = visit()

    def reach(what: str) -> None:
        """what: the words of a control, or its kind of element."""
        for _ in range(80):
            visitor.page.keyboard.press("Tab")
            focus = "[document.activeElement.innerText || '', document.activeElement.tagName]"
            text, kind = visitor.page.evaluate(focus)
            if what == kind or text.strip() == what:
                return
        pytest.fail(f"{what!r} cannot be reached with the Tab key")

    def press(what: str) -> None:
        reach(what)
        visitor.page.keyboard.press("Enter")

    press("LiDAR lines")
    visitor.page.wait_for_selector(".viewer[data-ready]")
    press("Complete")
    visitor.facts()
    press("Draw a hole")
    visitor.page.wait_for_selector(".hole canvas")
    reach("CANVAS")
    for key in ("ArrowDown", " ", "ArrowDown", " "):
        visitor.page.keyboard.press(key)
    strokes = json.loads(visitor.page.get_attribute(".hole", "data-strokes") or "[]")
    assert len(strokes) == 2
    assert strokes[1][1] > strokes[0][1]
    press("Erase and complete")
    visitor.page.wait_for_selector(".box.hole")
    press("Downloads")
    visitor.page.wait_for_selector("#get-record:not([disabled])")
    reach("Record, .json")
    with visitor.page.expect_download() as download:
        visitor.page.keyboard.press("Enter")
    assert json.loads(download.value.path().read_text())["preset"] == "fast"


def test_a_narrow_window_shows_everything_below_each_other(visit: Visit) -> None:
    visitor = visit(width=400)
    visitor.open_sample("Room")
    visitor.complete()
    assert visitor.page.evaluate("document.documentElement.scrollWidth") <= 400
    left = {s.bounding_box()["x"] for s in visitor.page.locator(".viewer .stage").all()}
    assert len(left) == 1
    for name in ("Draw a hole", "3D", "The method", "Downloads"):
        assert visitor.page.get_by_role("tab", name=name).is_visible()
        visitor.tab(name)
        assert visitor.page.evaluate("document.documentElement.scrollWidth") <= 400


def test_the_method_is_shown_step_by_step(visit: Visit) -> None:
    visitor = visit()
    visitor.open_sample("Room")
    visitor.tab("The method")
    visitor.page.click("#method-start")
    visitor.page.wait_for_selector(".method .strip", timeout=3_000_000)
    titles = visitor.page.locator(".method figcaption").all_inner_texts()
    assert titles[:3] == ["Steered", "Not steered", "Linear interpolation"]
    assert [t.split(" step")[0] for t in titles[3:9:3]] == ["Early", "Late"]
    films = [visitor.page.get_by_role("group", name=n, exact=True) for n in titles[:2]]
    for film in films:
        times = [int(t.removeprefix("t = ")) for t in film.locator("figcaption").all_inner_texts()]
        assert len(times) > 5
        assert times == sorted(times, reverse=True)
    last = [film.locator("img").last.get_attribute("src") for film in films]
    assert last[0] != last[1]
    for picture in visitor.page.locator(".method img").all():
        assert picture.evaluate("image => image.naturalWidth") > 0


def test_what_has_no_result_says_so(visit: Visit) -> None:
    visitor = visit()
    visitor.open_sample("Room")
    for tab, note in (("3D", "#scene-note"), ("Downloads", "#downloads-note")):
        visitor.tab(tab)
        visitor.page.locator(note).get_by_text("There is no result yet").wait_for()
    visitor.complete()
    visitor.tab("Downloads")
    visitor.page.wait_for_selector("#get-record:not([disabled])")
    assert visitor.page.inner_text("#downloads-note").strip() == ""


@pytest.fixture
def foreign() -> Iterator[str]:
    """The address of another server on this machine, with an empty page."""

    class Empty(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.end_headers()

        def log_message(self, *_: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Empty) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()


def test_a_page_of_another_origin_reaches_nothing(
    browser: Any, served: Served, foreign: str
) -> None:
    page = browser.new_page()
    page.set_default_timeout(PATIENCE_MS)
    page.goto(foreign)
    statuses: list[int] = []
    page.on("response", lambda answer: statuses.append(answer.status))
    ask = """async (url) => {
        const files = new FormData();
        files.append("files", new Blob(["x"]), "x.png");
        await fetch(url + "gradio_api/upload", {method: "POST", mode: "no-cors", body: files});
        return fetch(url + "config").then((answer) => answer.text(), () => "");
    }"""
    assert page.evaluate(ask, served.url) in ("", "This page answers its own origin only.")
    assert statuses == [403, 403]
    show = """src => new Promise(done => {
        const frame = Object.assign(document.createElement("iframe"), {src, onload: done});
        document.body.append(frame);
    })"""
    page.evaluate(show, served.url)
    assert all("SteeredMarigold" not in frame.content() for frame in page.frames)
    page.close()


def test_with_an_auth_file_only_those_in_it_come_in(browser: Any, tmp_path: Path) -> None:
    (tmp_path / "accounts.txt").write_text("# colleagues\nann:open: sesame\n")
    with serve(tmp_path, "--auth-file", str(tmp_path / "accounts.txt")) as served:
        with pytest.raises(urllib.error.HTTPError) as refused:
            urllib.request.urlopen(served.url + "config")
        with refused.value as answer:
            assert answer.status == 401
        page = browser.new_page()
        page.set_default_timeout(PATIENCE_MS)
        page.goto(served.url)
        for password in ("open", "open: sesame"):
            page.get_by_label("username").fill("ann")
            page.get_by_label("password").fill(password)
            page.get_by_role("button", name="Login").click()
            if password == "open":
                page.get_by_text("Incorrect Credentials").wait_for()
                assert page.locator(".viewer").count() == 0
        page.wait_for_selector(".viewer .empty")
        page.close()


@pytest.mark.parametrize(
    ("path", "headers"),
    [
        ("", {"Origin": "http://evil.example"}),
        ("", {"Host": "evil.example"}),
        ("gradio_api/file=/etc/passwd", {}),
        ("gradio_api/file=http://127.0.0.1:1/x", {}),
    ],
)
def test_strangers_and_other_files_are_refused(
    served: Served, path: str, headers: dict[str, str]
) -> None:
    request = urllib.request.Request(served.url + path, headers=headers)
    with pytest.raises(urllib.error.HTTPError) as refused:
        urllib.request.urlopen(request)
    with refused.value as answer:
        assert answer.status in (400, 403)
