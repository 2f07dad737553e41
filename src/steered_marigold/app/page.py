"""The page: which control does what."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import gradio as gr

from steered_marigold.app import words
from steered_marigold.app.actions import Actions, Run, Shown
from steered_marigold.app.layout import Layout, build_layout
from steered_marigold.app.running import OnStep
from steered_marigold.app.sessions import Session, Sessions
from steered_marigold.diffusion.settings import PRESETS
from steered_marigold.errors import SteeredMarigoldError
from steered_marigold.frames.sources import Reading
from steered_marigold.io.intrinsics import read_intrinsics

Updates = dict[Any, Any]
_ONE_AT_A_TIME: dict[str, Any] = {"concurrency_id": "model", "concurrency_limit": 1}
# what was painted is in the page until it is sent
_STROKES = "(_, ...rest) => [document.querySelector('#canvas .hole').dataset.strokes, ...rest]"
_QUIET: dict[str, Any] = {"api_visibility": "private", "show_progress": "hidden"}


def build_page(actions: Actions, sessions: Sessions) -> gr.Blocks:
    """The page, not served yet."""
    page = gr.Blocks(
        title="SteeredMarigold", analytics_enabled=False, fill_width=True, delete_cache=(600, 3600)
    )
    with page:
        wiring = _Wiring(
            build_layout(list(actions.models.checkpoints), actions.disk), actions, sessions
        )
        wiring.connect_frame()
        wiring.connect_disk()
        wiring.connect_runs()
        wiring.connect_results()

        def leave(request: gr.Request) -> None:
            sessions.close(str(request.session_hash))

        page.unload(leave)
    page.queue(max_size=actions.limits.queue, default_concurrency_limit=4, api_open=False)
    return page


class _Wiring:
    """Joins controls with actions.

    What is joined to an event gets the session and the values of its inputs, and returns the
    components that change. An error of the package becomes a sentence on the page, and changes
    nothing else.
    """

    def __init__(self, page: Layout, actions: Actions, sessions: Sessions) -> None:
        self.page, self.actions, self.sessions = page, actions, sessions
        self.downloads = list(page.downloads.values())

    def connect_frame(self) -> None:
        """Samples, uploads, and how they are read."""
        page, reading = self.page, self.page.reading

        def open_sample(session: Session, name: str) -> Updates:
            shown, camera = self.actions.open_sample(session, name)
            cleared = dict.fromkeys((reading.scale, reading.farthest, reading.baseline))
            plain = {reading.encoding: "z", reading.member: "", reading.registered: False}
            return self._fresh(shown) | cleared | plain | {reading.camera: camera}

        fresh = self._fresh_outputs()
        for name, button in page.samples.items():
            act = partial(open_sample, name=name)
            self._on(button.click, act, [], [*fresh, *reading.all()])

        def upload_image(session: Session, path: Any, *how: Any) -> Updates:
            return self._fresh(self.actions.upload(session, _reading(*how), image=path))

        def upload_depth(session: Session, paths: Any, *how: Any) -> Updates:
            return self._fresh(self.actions.upload(session, _reading(*how), depth=paths))

        def read_again(session: Session, *how: Any) -> Updates:
            if session.image is None:
                return {}
            return self._fresh(self.actions.read(session, _reading(*how), how[-2] or ""))

        self._on(page.image.upload, upload_image, [page.image, *reading.all()], fresh)
        self._on(page.depth.upload, upload_depth, [page.depth, *reading.all()], fresh)
        self._on(reading.apply.click, read_again, reading.all(), fresh)

    def connect_disk(self) -> None:
        """Frames on the server's disk, where there are any."""
        page, disk, fields = self.page, self.actions.disk, self.page.disk
        if disk is None or fields is None:
            return

        def look(session: Session) -> Updates:
            return {
                fields.images: gr.update(choices=disk.images()),
                fields.depths: gr.update(choices=disk.depths()),
            }

        def list_frames(session: Session, images: str | None, depths: str | None) -> Updates:
            found = disk.frames(images, depths) if images else []
            return {fields.frame: gr.update(choices=found, value=None)}

        def open_frame(
            session: Session, images: str, depths: str | None, frame: str | None, *how: Any
        ) -> Updates:
            if not frame:
                return {}
            shown = self.actions.open_on_disk(session, images, depths, frame, _reading(*how))
            return self._fresh(shown)

        chosen = [fields.images, fields.depths]
        self._on(fields.refresh.click, look, [], chosen)
        for field in chosen:
            self._on(field.input, list_frames, chosen, [fields.frame])
        inputs = [*chosen, fields.frame, *page.reading.all()]
        self._on(fields.frame.input, open_frame, inputs, self._fresh_outputs())

    def connect_runs(self) -> None:
        """What runs the model, one after the other."""
        page, run = self.page, self.page.run

        def complete(session: Session, on_step: OnStep, *how: Any) -> Updates:
            return self._result(self.actions.complete(session, Run(*how), on_step))

        def erase(session: Session, on_step: OnStep, strokes: str, *how: Any) -> Updates:
            self.actions.erase(session, strokes)
            return complete(session, on_step, *how)

        def restore(session: Session, on_step: OnStep, *how: Any) -> Updates:
            self.actions.restore(session)
            return complete(session, on_step, *how) | {page.canvas: self.actions.canvas(session)}

        def method(session: Session, on_step: OnStep, *how: Any) -> Updates:
            return {page.method: self.actions.method(session, Run(*how), on_step)}

        results = [
            page.view, page.facts, page.warnings, page.scene, page.canvas, page.tabs,
            *self.downloads,
        ]  # fmt: skip
        self._on_run(page.complete.click, complete, run.all(), results)
        self._on_run(page.erase.click, erase, [page.strokes, *run.all()], results, js=_STROKES)
        self._on_run(page.restore.click, restore, run.all(), results)
        self._on_run(page.method_start.click, method, run.all(), [page.method])

        def cancel(request: gr.Request) -> None:
            self._session(request).stop.set()

        page.cancel.click(cancel, queue=False, **_QUIET)

        def own_strength(preset: str) -> float:
            return PRESETS[preset].steering.steering_strength

        run.preset.input(own_strength, run.preset, run.strength, queue=False, **_QUIET)

    def connect_results(self) -> None:
        """What is made of a result when its tab is opened."""
        page = self.page

        def canvas(session: Session) -> Updates:
            if session.frame is None or session.canvas_of is session.frame:
                return {}
            session.canvas_of = session.frame
            return {page.canvas: self.actions.canvas(session)}

        def scene(session: Session, most_uncertain: float) -> Updates:
            if session.completed is None:
                return {page.scene_note: words.box("note", words.NO_RESULT)}
            path, distance, note = self.actions.mesh(session, most_uncertain)
            seen_from = (90, 85, distance or None)  # where the camera was, a little higher
            return {
                page.scene: gr.update(value=str(path), camera_position=seen_from),
                page.scene_note: note,
            }

        def downloads(session: Session) -> Updates:
            if session.completed is None:
                return {page.downloads_note: words.box("note", words.NO_RESULT)}
            found = self.actions.downloads(session)
            return {page.downloads_note: ""} | {
                page.downloads[kind]: gr.update(value=str(path), interactive=True)
                for kind, path in found.items()
            }

        self._on(page.hole_tab.select, canvas, [], [page.canvas])
        for listener in (page.scene_tab.select, page.certainty.release):
            self._on(listener, scene, [page.certainty], [page.scene, page.scene_note])
        self._on(page.downloads_tab.select, downloads, [], [page.downloads_note, *self.downloads])

    # what the events share

    def _fresh_outputs(self) -> list[Any]:
        page = self.page
        return [
            page.view, page.source, page.warnings, page.facts, page.canvas, page.scene,
            page.scene_note, page.method, page.tabs, *self.downloads,
        ]  # fmt: skip

    def _fresh(self, shown: Shown) -> Updates:
        """Another frame: its pictures, and nothing of the one before."""
        page = self.page
        return self._no_downloads() | {
            page.view: shown.view,
            page.source: f"<p>{shown.facts}</p>" if shown.facts else "",
            page.warnings: shown.warnings,
            page.facts: "",
            page.canvas: {},
            page.scene: None,
            page.scene_note: "",
            page.method: {},
            page.tabs: gr.update(selected="pictures"),
        }

    def _result(self, shown: Shown) -> Updates:
        """Another result of the same frame."""
        page = self.page
        return self._no_downloads() | {
            page.view: shown.view,
            page.facts: shown.facts,
            page.warnings: shown.warnings,
            page.scene: None,
            page.tabs: gr.update(selected="pictures"),
        }

    def _no_downloads(self) -> Updates:
        return {button: gr.update(value=None, interactive=False) for button in self.downloads}

    def _session(self, request: gr.Request) -> Session:
        return self.sessions.of(str(request.session_hash))

    def _said(self, act: Callable[[Session], Updates], request: gr.Request) -> Updates:
        """What `act` changes; or why it could not."""
        session = self._session(request)
        try:
            return {self.page.message: "", **act(session)}
        except SteeredMarigoldError as error:
            hidden = tuple({str(p.parent) for p in (session.image, session.depth) if p is not None})
            text = words.in_words_of_the_page(str(error), hidden)
            return {self.page.message: words.box("error", text)}

    def _on(
        self,
        listener: Callable[..., Any],
        act: Callable[..., Updates],
        inputs: Sequence[Any],
        outputs: Sequence[Any],
    ) -> None:
        def handle(request: gr.Request, *values: Any) -> Updates:
            return self._said(lambda session: act(session, *values), request)

        listener(handle, list(inputs), [*outputs, self.page.message], **_QUIET)

    def _on_run(
        self,
        listener: Callable[..., Any],
        act: Callable[..., Updates],
        inputs: Sequence[Any],
        outputs: Sequence[Any],
        js: str | None = None,
    ) -> None:
        """As `_on`, for what takes long: progress is shown, and it can be cancelled."""
        page = self.page
        starts = [page.complete, page.erase, page.restore, page.method_start]

        def begin(request: gr.Request) -> list[Any]:
            self._session(request).stop.clear()
            return [gr.update(interactive=False)] * len(starts) + [gr.update(interactive=True)]

        def handle(
            request: gr.Request,
            progress: gr.Progress = gr.Progress(),  # noqa: B008
            *values: Any,
        ) -> Updates:
            def on_step(done: int, total: int) -> None:
                progress((done, total), desc="Step", unit="steps")

            return self._said(lambda session: act(session, on_step, *values), request)

        def end() -> list[Any]:
            return [gr.update(interactive=True)] * len(starts) + [gr.update(interactive=False)]

        buttons = [*starts, page.cancel]
        listener(begin, None, buttons, queue=False, **_QUIET).then(
            handle,
            list(inputs),
            [*outputs, page.message],
            show_progress="full",
            show_progress_on=page.status,
            api_visibility="private",
            js=js,
            **_ONE_AT_A_TIME,
        ).then(end, None, buttons, queue=False, **_QUIET)


def _reading(
    encoding: str,
    scale: float | None,
    farthest: float | None,
    baseline: float | None,
    camera: str | None,
    member: str,
    registered: bool,
) -> Reading:
    """The fields of `layout.ReadingFields`, in their order; 0 is an empty field."""
    return Reading(
        depth_scale=scale or None,
        max_depth=farthest or None,
        depth_encoding=encoding,
        baseline=baseline or None,
        registered=registered,
        intrinsics=read_intrinsics(camera) if camera and camera.strip() else None,
    )
