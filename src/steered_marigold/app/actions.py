"""What the page's controls do, without the page: values in, what is shown out."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from jaxtyping import Bool
from PIL import Image, ImageDraw
from torch import Tensor

from steered_marigold.app import inputs, words
from steered_marigold.app.meshes import guessed_intrinsics, write_mesh
from steered_marigold.app.running import Models, OnStep, StoppedError, Watch, WatchedCompleter
from steered_marigold.app.sessions import Session
from steered_marigold.app.steps import method_view, run_method
from steered_marigold.app.views import View, canvas_view, completed_view, frame_view
from steered_marigold.core.frame import Frame
from steered_marigold.errors import InputError
from steered_marigold.frames.complete import complete_frame
from steered_marigold.frames.outputs import Outputs, save
from steered_marigold.frames.sources import FrameFiles, Reading


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What one visitor may ask for.

    upload_mb: of a file. megapixels: of an image. seconds: of a run. queue: waiting runs.
    visitors: remembered at a time.
    """

    upload_mb: int = 64
    megapixels: float = 12.0
    seconds: float = 300.0
    queue: int = 16
    visitors: int = 32


@dataclass(frozen=True)
class Run:
    """How to complete. checkpoint: by the name that the page shows."""

    checkpoint: str
    preset: str
    steering_strength: float
    seed: int


class Shown(NamedTuple):
    """Of a frame or a result: pictures and numbers, facts in words, warnings."""

    view: View
    facts: str
    warnings: str


class Actions:
    """One for the server; each call is given the session that it is for."""

    def __init__(self, models: Models, limits: Limits, disk: inputs.Disk | None = None) -> None:
        self.models, self.limits, self.disk = models, limits, disk

    # choosing a frame

    def open_sample(self, session: Session, name: str) -> tuple[Shown, str]:
        """The sample, and its camera as "fx,fy,cx,cy"."""
        files, reading = inputs.sample(name)
        session.image, session.depth = files.image, files.depth
        shown = self.read(session, reading)
        assert session.frame is not None
        K = session.frame.K
        assert K is not None
        camera = ",".join(f"{float(K[i]):.1f}" for i in ((0, 0), (1, 1), (0, 2), (1, 2)))
        return shown, camera

    def upload(
        self,
        session: Session,
        reading: Reading,
        *,
        image: str | None = None,
        depth: list[str] | None = None,
    ) -> Shown:
        """Keeps the files; reads the frame once both the image and its depth are there."""
        for name in ("image", "depth"):
            path = getattr(session, name)
            if path is not None and not path.is_relative_to(session.folder):
                setattr(session, name, None)  # of a sample, or of the server
        if image is not None:
            session.image = session.keep(image, "image")
        if depth:
            kept = [session.keep(path, "depth") for path in depth]
            session.depth = inputs.depth_file(kept)
            if session.depth is None:
                raise InputError(
                    f"{kept[0].name}: is no depth map that this page can read; .png of 16 bits, "
                    ".tiff, .npy, .npz, .exr, .pfm and .h5 are"
                )
        if session.image is None:
            return Shown({"empty": "Now choose the image that belongs to the depth map."}, "", "")
        return self.read(session, reading)

    def open_on_disk(
        self, session: Session, images: str, depths: str | None, frame_id: str, reading: Reading
    ) -> Shown:
        """A frame below the server's root."""
        assert self.disk is not None
        files = self.disk.files(images, depths, frame_id)
        if files is not None:
            session.image, session.depth = files.image, files.depth
            return self.read(session, reading)
        session.image = session.depth = None
        frame = self.disk.recorded(images, int(frame_id), most_megapixels=self.limits.megapixels)
        return self._show(session, frame, reading)

    def read(self, session: Session, reading: Reading, member: str = "") -> Shown:
        """The open files as a frame. member: the array of an archive such as .npz."""
        if session.image is None:
            raise InputError("There is no frame yet: choose a sample, or an image and its depth.")
        depth = session.depth
        if depth is not None and member:
            depth = depth.with_name(f"{depth.name}:{member}")
        files = FrameFiles(image=session.image, depth=depth)
        frame = inputs.checked_frame(files, reading, most_megapixels=self.limits.megapixels)
        return self._show(session, frame, reading, depth)

    def _show(
        self, session: Session, frame: Frame, reading: Reading, depth: Path | None = None
    ) -> Shown:
        session.show(frame)
        notices = words.warnings(frame.notices)
        return Shown(frame_view(frame), inputs.stored_as(depth, frame, reading), notices)

    # completing

    def complete(self, session: Session, run: Run, on_step: OnStep) -> Shown:
        """Completes what is open, without what was erased."""
        frame = _opened(session)
        given = frame if session.erased is None else frame.keep(~session.erased)
        completer = self.models.completer(
            run.checkpoint, preset=run.preset, steering_strength=run.steering_strength
        )
        watched = WatchedCompleter(completer, self._watch(session, on_step))
        completion, record = complete_frame(
            watched, given, seed=run.seed, no_measurements=not frame.measured
        )
        if session.frame is not frame:
            raise StoppedError("Another frame was opened meanwhile.")
        session.completed = given, completion, record
        facts = words.facts(record)
        if session.erased is not None:
            facts = words.hole_facts(completion, frame, session.erased) + facts
        truth = None if session.erased is None else frame
        view = completed_view(given, completion, truth)
        return Shown(view, facts, words.warnings(record.notices))

    def canvas(self, session: Session) -> View:
        """What holes are drawn on."""
        return canvas_view(_opened(session))

    def erase(self, session: Session, strokes: str) -> None:
        """Hides the measurements under what was painted; strokes: see `painted`.

        Raises InputError if nothing was painted, or everything.
        """
        frame = _opened(session)
        erased = painted(strokes, frame.size)
        if not erased.any():
            raise InputError("Nothing is painted yet: paint over measured pixels first.")
        if not (frame.valid_mask & ~erased).any():
            raise InputError("Every measurement is painted over: leave some of them.")
        session.erased = erased

    def restore(self, session: Session) -> None:
        """Nothing is erased."""
        session.erased = None

    def method(self, session: Session, run: Run, on_step: OnStep) -> View:
        """The paper's method step by step, on what is open."""
        frame = _opened(session)
        if session.erased is not None:
            frame = frame.keep(~session.erased)
        watch = self._watch(session, on_step)
        method = run_method(self.models, run.checkpoint, frame, seed=run.seed, watch=watch)
        return method_view(method, frame)

    def _watch(self, session: Session, on_step: OnStep) -> Watch:
        return Watch(on_step=on_step, stop=session.stop, longest_s=self.limits.seconds)

    # taking away

    def mesh(self, session: Session, most_uncertain: float | None) -> tuple[Path, float, str]:
        """The result as a .glb file, from how far it was seen [m], and what to know of it."""
        frame, completion, _ = _completed(session)
        if not completion.metric:
            raise InputError("Nothing was measured, so there are no metres to build a scene of.")
        sigma = completion.uncertainty
        path = session.folder / "scene.glb"
        distance = write_mesh(
            path,
            completion.depth[0],
            frame.image,
            guessed_intrinsics(frame.size) if frame.K is None else frame.K,
            uncertainty=None if sigma is None else sigma[0],
            most_uncertain=most_uncertain,
        )
        guessed = "The camera is not known: the scene assumes a view 60° wide."
        return path, distance, "" if frame.K is not None else words.box("note", guessed)

    def downloads(self, session: Session) -> dict[str, Path]:
        """The files of the result, by kind; those that it has."""
        frame, completion, record = _completed(session)
        folder = session.folder / "results"
        folder.mkdir(exist_ok=True)
        stem = frame.id or "frame"
        files = {f"depth{suffix}": folder / f"{stem}_depth{suffix}" for suffix in _SUFFIXES}
        if completion.uncertainty is not None:
            files["uncertainty"] = folder / f"{stem}_uncertainty.npy"
        if frame.K is not None and completion.metric:
            files["cloud"] = folder / f"{stem}_cloud.ply"
        for suffix in _SUFFIXES:
            extra = suffix == _SUFFIXES[0]
            outputs = Outputs(
                depth=files[f"depth{suffix}"],
                uncertainty=files.get("uncertainty") if extra else None,
                point_cloud=files.get("cloud") if extra else None,
            )
            _, notices = save(completion, frame, outputs)
            record = record.extended({}, *notices)
        files["record"] = folder / f"{stem}_record.json"
        files["record"].write_text(json.dumps(record.to_json(), indent=2) + "\n")
        return files


_MOST_DISCS = 20_000  # of a brush
_SUFFIXES = (".png", ".npy", ".exr")


def painted(strokes: str, size: tuple[int, int]) -> Bool[Tensor, "height width"]:
    """The pixels under the discs of a brush, in an image of `size` (height, width).

    strokes: JSON, a list of [x, y, radius] in pixels. Raises InputError for anything else.
    """
    mask = Image.new("1", size[::-1])
    brush = ImageDraw.Draw(mask)
    try:
        for x, y, radius in json.loads(strokes)[:_MOST_DISCS]:
            brush.ellipse((x - radius, y - radius, x + radius, y + radius), fill=1)
    except (TypeError, ValueError) as error:
        raise InputError(f"The strokes of the brush cannot be read: {error}") from error
    return torch.from_numpy(np.array(mask))


def _opened(session: Session) -> Frame:
    if session.frame is None:
        raise InputError("There is no frame yet: choose a sample, or an image and its depth.")
    return session.frame


def _completed(session: Session) -> Any:
    if session.completed is None:
        raise InputError(words.NO_RESULT)
    return session.completed
