"""What is written of a completed frame, and where."""

from dataclasses import dataclass, replace
from functools import reduce
from operator import and_
from pathlib import Path
from typing import Any

from steered_marigold.core.completion import DepthCompletion
from steered_marigold.core.frame import Frame
from steered_marigold.core.notices import Notice, Notices
from steered_marigold.errors import InputError
from steered_marigold.frames.complete import require_uncertainty
from steered_marigold.frames.sources import FrameFiles
from steered_marigold.io.depth_encodings import MILLIMETRE
from steered_marigold.io.depth_maps import (
    WRITABLE_DEPTH_SUFFIXES,
    write_depth,
    write_saturating,
)
from steered_marigold.io.files import atomic_writes, names_in, require_suffix, write_figure
from steered_marigold.io.point_clouds import point_cloud, write_point_cloud

# of the files of folders; those of depth and uncertainty are asked for
_SUFFIXES = {"visualization": ".png", "point_cloud": ".ply"}


@dataclass(frozen=True, kw_only=True)
class Outputs:
    """The files to write, None = not asked for; or, for many frames, their folders.

    depth: .png (uint16 in units of `output_scale`), .npy, .tiff or .exr (float32 [m]).
    uncertainty: likewise. visualization: .png. point_cloud: .ply; needs K.
    """

    depth: Path
    uncertainty: Path | None = None
    visualization: Path | None = None
    point_cloud: Path | None = None

    def asked(self) -> dict[str, Path]:
        """The paths that are not None, by name."""
        return {name: path for name, path in vars(self).items() if path is not None}

    def of_frame(self, frame_id: str, depth_suffix: str) -> "Outputs":
        """The files of a frame in these folders."""
        files = {
            name: folder / f"{frame_id}{_SUFFIXES.get(name, depth_suffix)}"
            for name, folder in self.asked().items()
        }
        return replace(self, **files)

    def done(self, depth_suffix: str) -> set[str]:
        """Ids of the frames that have all their files in these folders.

        One look into each folder, not one for each of a million files.
        """
        there = (
            _stems_in(folder, _SUFFIXES.get(name, depth_suffix))
            for name, folder in self.asked().items()
        )
        return reduce(and_, there)

    def in_folders(self, frame_id: str, depth_suffix: str) -> "Outputs":
        """With a frame's file in the place of each path that is an existing folder."""
        files = self.of_frame(frame_id, depth_suffix).asked()
        return replace(self, **{n: files[n] for n, path in self.asked().items() if path.is_dir()})

    def require_possible(self, *, has_K: bool, output_scale: float | None) -> None:
        """InputError for extensions that there are not, or what lacks for an output."""
        maps = [path for path in (self.depth, self.uncertainty) if path is not None]
        suffixes = [require_suffix(path, WRITABLE_DEPTH_SUFFIXES) for path in maps]
        if self.visualization is not None:
            require_suffix(self.visualization, (".png",))
        if self.point_cloud is not None:
            require_suffix(self.point_cloud, (".ply",))
            if not has_K:
                raise InputError("`point_cloud` needs the camera: give `intrinsics`")
        if output_scale is not None and ".png" not in suffixes:
            raise InputError("`output_scale` is for .png; the other formats hold metres")
        if output_scale is not None and not 0 < output_scale < float("inf"):
            raise InputError(f"`output_scale` must be a positive number, not {output_scale}")

    def require_distinct(self, inputs: FrameFiles) -> None:
        """InputError if an output would overwrite another one or an input."""
        taken = {path.resolve() for path in inputs.given()}
        for path in self.asked().values():
            if path.resolve() in taken:
                raise InputError(f"{path}: is named twice, or is an input; choose another output")
            taken.add(path.resolve())


def save(
    completion: DepthCompletion,
    frame: Frame,
    outputs: Outputs,
    *,
    output_scale: float | None = None,
) -> tuple[dict[str, Any], Notices]:
    """Writes what is asked for, all of it or nothing.

    Returns what a record says of it, and what a person should know.

    output_scale: metres per unit of .png files; None is 0.001.

    Raises InputError if a file cannot be written, or something was asked for that the completion
    or the frame does not have.
    """
    scale = (output_scale or MILLIMETRE) if completion.metric else 1 / 65535
    if outputs.uncertainty is not None:
        require_uncertainty(completion)
    if outputs.point_cloud is not None and (frame.K is None or not completion.metric):
        raise InputError("`point_cloud` needs `intrinsics`, and metric depth")
    asked = outputs.asked()
    last_first = list(reversed(asked.items()))  # depth stands for the frame's other files
    with atomic_writes([path for _, path in last_first]) as temporaries:
        beside = {name: path for (name, _), path in zip(last_first, temporaries, strict=True)}
        unrepresentable, points = _write(completion, frame, Outputs(**beside), scale)
    notices: Notices = ()
    if unrepresentable:
        notices = (Notice("unrepresentable", _does_not_fit(outputs.depth, unrepresentable, scale)),)
    written = {name: str(path) for name, path in asked.items() if name != "depth"}
    return {
        "output": str(outputs.depth),
        **written,
        "unrepresentable": unrepresentable,
        "points": points,
    }, notices


def _write(
    completion: DepthCompletion, frame: Frame, outputs: Outputs, scale: float
) -> tuple[int, int]:
    """How many depths did not fit their file, and how many points the cloud has."""
    depth, unrepresentable, points = completion.depth[0], 0, 0
    uncertainty = None if completion.uncertainty is None else completion.uncertainty[0]
    if completion.metric:
        unrepresentable = write_depth(outputs.depth, depth, output_scale=scale)
    else:
        write_saturating(outputs.depth, depth, output_scale=scale)
    if outputs.uncertainty is not None and uncertainty is not None:
        write_saturating(outputs.uncertainty, uncertainty, output_scale=scale)
    if outputs.point_cloud is not None and frame.K is not None:
        cloud = point_cloud(depth, frame.image, frame.K)
        write_point_cloud(outputs.point_cloud, cloud)
        points = len(cloud.points)
    if outputs.visualization is not None:
        from steered_marigold.pictures.panels import frame_panels  # matplotlib is slow to load

        figure = frame_panels(frame, depth, uncertainty, metric=completion.metric)
        write_figure(outputs.visualization, figure)
    return unrepresentable, points


def _stems_in(folder: Path, suffix: str) -> set[str]:
    """Of a folder's files with this suffix; none if there is no folder."""
    try:
        names = names_in(folder)
        return {name.removesuffix(suffix) for name in names if name.endswith(suffix)}
    except OSError:
        return set()


def _does_not_fit(path: Path, count: int, scale: float) -> str:
    return (
        f"{path}: {count} depths do not fit 16 bits of {scale} m and were written as 0; "
        ".npy, .tiff and .exr hold them, or another `output_scale`"
    )
