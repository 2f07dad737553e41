"""Frames and their completions as a Rerun recording (.rrd), to be looked at over time and in 3D."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from steered_marigold.core.completion import DepthCompletion
from steered_marigold.core.frame import Frame
from steered_marigold.errors import MissingExtraError
from steered_marigold.frames.sources import FrameFiles, Reading, folder_source, read_frame
from steered_marigold.io.depth_maps import read_depth
from steered_marigold.io.files import atomic_write, require_suffix, require_writable
from steered_marigold.io.point_clouds import point_cloud
from steered_marigold.methods.completer import DepthCompleter

TIMELINE = "frame"
COMPLETED = "completed"
# points that are less sure than this share of their depth are left out of the cloud
SURE = 0.1


class Viewing:
    """A Rerun recording that is being written; `rerun_log` makes one."""

    def __init__(self, rr: Any, recording: Any) -> None:
        self._rr, self._recording, self._count = rr, recording, 0

    def add(self, frame: Frame, completion: DepthCompletion) -> None:
        """A frame beside its completion: image, measured, completed, uncertainty, and clouds.

        Depth is in metres. Clouds need the frame's K. A frame with a stamp has it as its time.
        """
        self.compare(frame, {COMPLETED: completion})
        if completion.uncertainty is not None:
            sigma = completion.uncertainty[0].cpu()
            depth_image = self._rr.DepthImage(sigma.numpy(), meter=1.0, colormap="magma")
            self._recording.log("uncertainty", depth_image)

    def compare(self, frame: Frame, answers: Mapping[str, DepthCompletion]) -> None:
        """A frame beside several answers, by name; as `add`, without their uncertainty."""
        rr, log = self._rr, self._recording.log
        self._recording.set_time(TIMELINE, sequence=self._count)
        if frame.stamp is not None:
            self._recording.set_time("stamp", timestamp=frame.stamp)
        self._count += 1
        if frame.K is not None:
            height, width = frame.size
            pinhole = rr.Pinhole(
                image_from_camera=frame.K.numpy(),
                width=width,
                height=height,
                camera_xyz=rr.ViewCoordinates.RDF,
            )
            log("camera", pinhole)
        log("camera/image", rr.Image(frame.image.numpy()))
        log("camera/measured", rr.DepthImage(frame.sparse_depth.numpy(), meter=1.0))
        if frame.K is not None:
            self._add_cloud("measured", frame, frame.sparse_depth)
        for name, answer in answers.items():
            depth = answer.depth[0].cpu()
            log(["camera", name], rr.DepthImage(depth.numpy(), meter=1.0))
            if frame.K is not None and answer.metric:
                self._add_cloud(name, frame, _sure_depth(answer))

    def _add_cloud(self, name: str, frame: Frame, depth: torch.Tensor) -> None:
        assert frame.K is not None
        cloud = point_cloud(depth, frame.image, frame.K)
        points = self._rr.Points3D(cloud.points.numpy(), colors=cloud.colors.numpy(), radii=0.004)
        self._recording.log(["cloud", name], points)


def _sure_depth(completion: DepthCompletion) -> torch.Tensor:
    """Depth [m], 0 where its uncertainty is too large for the cloud."""
    depth = completion.depth[0].cpu()
    if completion.uncertainty is None:
        return depth
    return torch.where(completion.uncertainty[0].cpu() <= SURE * depth, depth, 0.0)


class ViewedCompleter(DepthCompleter):
    """Another completer, each of whose answers is added to a viewing."""

    def __init__(self, completer: DepthCompleter, viewing: Viewing) -> None:
        self.name, self.steers = completer.name, completer.steers
        self.answers_without_measurements = completer.answers_without_measurements
        self._completer, self._viewing = completer, viewing

    def describe(self) -> dict[str, Any]:
        return self._completer.describe()

    def _complete(self, frame: Frame, generator: torch.Generator) -> DepthCompletion:
        relative = self.answers_without_measurements
        answer = self._completer.answer(frame, generator=generator, relative=relative)
        self._viewing.add(frame, answer)
        return answer


def written_results(
    files: FrameFiles, dense: Path, uncertainty: Path | None, reading: Reading
) -> Iterator[tuple[Frame, DepthCompletion]]:
    """Results that were written before, as frames and completions; files, or folders of them.

    files.depth: what had been measured, or None. Raises InputError for what cannot be read.
    """
    if files.image.is_dir():
        answers = folder_source(replace(files, depth=dense), reading)
        given = folder_source(files, reading) if files.depth is not None else answers
        sigmas = _by_image(files.image, uncertainty, reading)
        for frame_id in answers.ids:
            found = answers.files[frame_id]
            before = replace(found, depth=given.files[frame_id].depth if files.depth else None)
            yield _written_result(before, found.depth or dense, sigmas.get(frame_id), reading)
    else:
        yield _written_result(files, dense, uncertainty, reading)


def _by_image(images: Path, folder: Path | None, reading: Reading) -> dict[str, Path]:
    """The files of a folder by the id of the image that they belong to."""
    if folder is None:
        return {}
    pairs = folder_source(FrameFiles(image=images, depth=folder), reading).files
    return {frame_id: files.depth for frame_id, files in pairs.items() if files.depth is not None}


def _written_result(
    files: FrameFiles, dense: Path, uncertainty: Path | None, reading: Reading
) -> tuple[Frame, DepthCompletion]:
    frame = read_frame(files, reading)
    sigma = None if uncertainty is None else read_depth(uncertainty).depth[None]
    return frame, written_answer(frame, read_depth(dense).depth, sigma)


def written_answer(
    frame: Frame,
    depth: Float[Tensor, "height width"],
    uncertainty: Float[Tensor, "1 height width"] | None = None,
) -> DepthCompletion:
    """Depth [m] that was kept, as an answer to the frame."""
    measured = frame.valid_mask[None]
    return DepthCompletion(
        depth=depth[None], measured=measured, trusted=measured, uncertainty=uncertainty
    )


@contextmanager
def rerun_log(path: Path, answers: Sequence[str] = (COMPLETED,)) -> Iterator[Viewing]:
    """A recording at `path`, .rrd, whole when the block ends, with a layout that opens well.

    answers: the names of what will be compared.

    Raises FileFormatError for another extension, InputError if it cannot be written,
    MissingExtraError without rerun-sdk.
    """
    rr, rrb = require_rerun(path)
    with atomic_write(path) as temporary:
        recording = rr.RecordingStream("steered-marigold", send_properties=False)
        recording.save(temporary, default_blueprint=_layout(rr, rrb, answers))
        up = rr.ViewCoordinates.RIGHT_HAND_Y_DOWN
        recording.log("cloud", up, static=True)
        try:
            yield Viewing(rr, recording)
        finally:
            recording.flush()
            recording.disconnect()


def require_rerun(path: Path) -> tuple[Any, Any]:
    """The modules `rerun` and `rerun.blueprint`; raises as `rerun_log`, before any work."""
    require_suffix(path, (".rrd",))
    require_writable(path)
    try:
        import rerun as rr  # an extra
        import rerun.blueprint as rrb
    except ImportError as error:
        raise MissingExtraError("rerun", "rerun-sdk") from error
    return rr, rrb


def _layout(rr: Any, rrb: Any, answers: Sequence[str]) -> Any:
    """The cloud beside the pictures, and nothing else open."""
    pictures = [
        rrb.Spatial2DView(origin=f"camera/{rr.escape_entity_path_part(name)}", name=name)
        for name in ("image", "measured", *answers)
    ]
    if COMPLETED in answers:
        pictures.append(rrb.Spatial2DView(origin="uncertainty", name="uncertainty [m]"))
    cloud = rrb.Spatial3DView(origin="cloud", name="cloud [m]")
    return rrb.Blueprint(
        rrb.Horizontal(cloud, rrb.Grid(*pictures), column_shares=[3, 4]),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
    )
