"""Records a visit to the page: docs/images/page.gif, and docs/images/page.png of its result.

    python docs/record_page.py

Needs Chromium and the extras `app` and `dev`. What is shown is a sample of the package, a room that
was rendered for it.
"""

import shutil
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

from PIL import Image
from playwright.sync_api import sync_playwright

from steered_marigold.app.server import Settings, serving

IMAGES = Path(__file__).parent / "images"
WINDOW = {"width": 1240, "height": 960}
WIDTH = 900  # pixels of the recording
COLOURS = 256
MOST_BYTES = 2_000_000
# screenshots have no pointer
POINTER = """
addEventListener("DOMContentLoaded", () => {
  const dot = document.createElement("div");
  dot.style = "position: fixed; z-index: 9999; width: 18px; height: 18px; margin: -9px;" +
    "border: 2px solid white; border-radius: 50%; background: rgb(15 118 110 / 55%);" +
    "pointer-events: none";
  document.body.append(dot);
  addEventListener("pointermove", (event) => {
    dot.style.left = `${event.clientX}px`;
    dot.style.top = `${event.clientY}px`;
  }, true);
});
"""


class Recorder:
    """Screenshots of a page, and for how long each is shown [ms]."""

    def __init__(self, page: Any) -> None:
        self.page = page
        self.frames: list[Image.Image] = []
        self.durations: list[int] = []

    def show(self, milliseconds: int) -> None:
        """What the page shows now."""
        shot = Image.open(BytesIO(self.page.screenshot())).convert("RGB")
        height = round(shot.height * WIDTH / shot.width)
        self.frames.append(shot.resize((WIDTH, height), Image.Resampling.LANCZOS))
        self.durations.append(milliseconds)

    def click(self, control: Any) -> None:
        """Moves the pointer there first."""
        control.hover()
        self.show(500)
        control.click()

    def save(self, path: Path) -> None:
        """As a GIF of one palette, so that what stays the same costs little."""
        sheet = Image.new("RGB", (WIDTH, sum(frame.height for frame in self.frames)))
        for row, frame in enumerate(self.frames):
            sheet.paste(frame, (0, row * frame.height))
        palette = sheet.quantize(COLOURS, method=Image.Quantize.MEDIANCUT)
        first, *others = (
            frame.quantize(palette=palette, dither=Image.Dither.FLOYDSTEINBERG)
            for frame in self.frames
        )
        first.save(
            path,
            save_all=True,
            append_images=others,
            duration=self.durations,
            loop=0,
            optimize=True,
        )


def visit(recorder: Recorder, url: str) -> None:
    """Sample, result, a hole and its error, the scene from the side."""
    page = recorder.page
    page.goto(url)
    page.wait_for_selector(".viewer .empty")
    recorder.show(1200)
    recorder.click(page.get_by_role("button", name="Room"))
    page.wait_for_selector(".viewer[data-ready]")
    recorder.show(1500)
    recorder.click(page.get_by_role("button", name="Complete", exact=True))
    page.wait_for_selector("#facts li")
    page.wait_for_selector("#complete:not([disabled])")
    for x, y in across(page.locator(".viewer .stage").nth(0), (0.5, 0.5), (0.72, 0.4), 2):
        page.mouse.move(x, y)
        recorder.show(900)
    whole = Image.open(BytesIO(page.screenshot(full_page=True))).convert("RGB")
    whole.save(IMAGES / "page.png", optimize=True)
    draw_hole(recorder)
    turn(recorder)


def draw_hole(recorder: Recorder) -> None:
    """Over the floor, in front of the sofa."""
    page = recorder.page
    recorder.click(page.get_by_role("tab", name="Draw a hole"))
    canvas = page.locator(".hole canvas")
    canvas.wait_for()
    page.locator(".hole input").fill("80")
    (x, y), *others = across(canvas, (0.36, 0.86), (0.62, 0.74), 4)
    page.mouse.move(x, y)
    recorder.show(900)
    page.mouse.down()
    for x, y in others:
        page.mouse.move(x, y, steps=4)
        recorder.show(250)
    page.mouse.up()
    recorder.click(page.locator("#erase"))
    page.wait_for_selector(".box.hole")
    page.wait_for_selector("#complete:not([disabled])")
    page.mouse.move(20, 20)
    recorder.show(2500)
    error = page.locator(".viewer figure").last
    error.scroll_into_view_if_needed()
    recorder.show(2000)
    page.mouse.wheel(0, -5000)
    page.wait_for_timeout(500)


def turn(recorder: Recorder) -> None:
    """The scene, by its middle."""
    page = recorder.page
    recorder.click(page.get_by_role("tab", name="3D"))
    scene = page.locator("#scene canvas")
    scene.wait_for()
    wait_for_scene(scene)
    middle, right, left = (0.5, 0.5), (0.55, 0.51), (0.46, 0.49)
    (x, y), *others = across(scene, middle, right, 3)
    page.mouse.move(x, y)
    recorder.show(900)
    page.mouse.down()
    for x, y in (*others, *across(scene, right, left, 4)):
        page.mouse.move(x, y)
        page.wait_for_timeout(400)
        recorder.show(200)
    page.mouse.up()
    recorder.durations[-1] = 2500


def wait_for_scene(scene: Any) -> None:
    """Until it shows more than its background."""
    for _ in range(200):
        # of the page: a screenshot of an element waits for it to stand still
        shot = scene.page.screenshot(clip=scene.bounding_box())
        shown = Image.open(BytesIO(shot)).convert("L")
        if len(shown.getcolors() or []) > 100:
            return
        scene.page.wait_for_timeout(500)
    raise RuntimeError("the scene did not appear")


def across(
    element: Any, begin: tuple[float, float], end: tuple[float, float], count: int
) -> Iterator[tuple[float, float]]:
    """Places from one to the other, both in shares of the element."""
    element.evaluate("element => element.scrollIntoView({block: 'nearest'})")
    box = element.bounding_box()
    for share in (i / (count - 1) for i in range(count)):
        x, y = (b + share * (e - b) for b, e in zip(begin, end, strict=True))
        yield box["x"] + x * box["width"], box["y"] + y * box["height"]


def main() -> None:
    """Serves the page and visits it."""
    with serving(Settings()) as url, sync_playwright() as tools:
        chromium = tools.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox", "--disable-gpu"]
        )
        page = chromium.new_page(viewport=WINDOW)
        page.set_default_timeout(300_000)
        page.add_init_script(POINTER)
        recorder = Recorder(page)
        visit(recorder, url)
        chromium.close()
    path = IMAGES / "page.gif"
    recorder.save(path)
    if path.stat().st_size > MOST_BYTES:
        raise SystemExit(f"{path} is larger than {MOST_BYTES / 1e6:g} MB: take fewer colours")


if __name__ == "__main__":
    main()
