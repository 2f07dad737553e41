"""Frames and their completions as a Rerun recording (.rrd), to be looked at over time and in 3D."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch

from steered_marigold.core.completion import DepthCompletion
from steered_marigold.core.frame import Frame
from steered_marigold.errors import MissingExtraError
from steered_marigold.frames.sources import FrameFiles, Reading, folder_source, read_frame
from steered_marigold.io.depth_maps import read_depth
from steered_marigold.io.files import atomic_write, require_suffix
from steered_marigold.io.point_clouds import point_cloud
from steered_marigold.methods.completer import DepthCompleter

TIMELINE = "frame"
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
        rr, log = self._rr, self._recording.log
        self._recording.set_time(TIMELINE, sequence=self._count)
        if frame.stamp is not None:
            self._recording.set_time("stamp", timestamp=frame.stamp)
        self._count += 1
        depth = completion.depth[0].cpu()
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
        log("camera/completed", rr.DepthImage(depth.numpy(), meter=1.0))
        sure = torch.ones_like(frame.valid_mask)
        if completion.uncertainty is not None:
            sigma = completion.uncertainty[0].cpu()
            log("uncertainty", rr.DepthImage(sigma.numpy(), meter=1.0, colormap="magma"))
            sure = sigma <= SURE * depth
        if frame.K is not None and completion.metric:
            self._add_cloud("cloud/measured", frame, frame.sparse_depth)
            self._add_cloud("cloud/completed", frame, torch.where(sure, depth, 0.0))

    def _add_cloud(self, where: str, frame: Frame, depth: torch.Tensor) -> None:
        assert frame.K is not None
        cloud = point_cloud(depth, frame.image, frame.K)
        points = self._rr.Points3D(cloud.points.numpy(), colors=cloud.colors.numpy(), radii=0.004)
        self._recording.log(where, points)


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
    answer = read_depth(dense)
    sigma = None if uncertainty is None else read_depth(uncertainty).depth[None]
    measured = frame.valid_mask[None]
    completion = DepthCompletion(
        depth=answer.depth[None], measured=measured, trusted=measured, uncertainty=sigma
    )
    return frame, completion


@contextmanager
def rerun_log(path: Path) -> Iterator[Viewing]:
    """A recording at `path`, .rrd, whole when the block ends, with a layout that opens well.

    Raises FileFormatError for another extension, InputError if it cannot be written,
    MissingExtraError without rerun-sdk.
    """
    require_suffix(path, (".rrd",))
    try:
        import rerun as rr  # an extra
        import rerun.blueprint as rrb
    except ImportError as error:
        raise MissingExtraError("rerun", "rerun-sdk") from error
    pictures = [
        rrb.Spatial2DView(origin=f"camera/{name}", name=name)
        for name in ("image", "measured", "completed")
    ]
    layout = rrb.Blueprint(
        rrb.Horizontal(
            rrb.Spatial3DView(origin="cloud", name="cloud [m], measured and completed"),
            rrb.Grid(*pictures, rrb.Spatial2DView(origin="uncertainty", name="uncertainty [m]")),
            column_shares=[3, 4],
        ),
        rrb.TimePanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
    )
    with atomic_write(path) as temporary:
        recording = rr.RecordingStream("steered-marigold", send_properties=False)
        recording.save(temporary, default_blueprint=layout)
        up = rr.ViewCoordinates.RIGHT_HAND_Y_DOWN
        recording.log("cloud", up, static=True)
        try:
            yield Viewing(rr, recording)
        finally:
            recording.flush()
            recording.disconnect()
