"""A folder of frames, the simplest data set."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import ClassVar

from steered_marigold.core.frame import make_frame
from steered_marigold.datasets.dataset import check_sizes, files_by_stem
from steered_marigold.datasets.sample import Sample
from steered_marigold.errors import FileFormatError
from steered_marigold.io.depth_files import DEPTH_SUFFIXES
from steered_marigold.io.depth_maps import read_depth
from steered_marigold.io.images import IMAGE_SUFFIXES, read_image
from steered_marigold.io.intrinsics import read_intrinsics


@dataclass(frozen=True)
class FrameFolder:
    """`rgb/` and `depth/` with one file a frame, paired by their names without extension.

    Optional: `sparse/` with what a sensor measured, `K.txt` with the intrinsics of all frames. The
    ground truth may be named `gt/` instead (the layout of Marigold-DC: rgb/, sparse/*.npy,
    gt/*.npy). Without `rgb/`, each subfolder that holds an image named `rgb` is a frame: its depth
    map is named `depth`, and its intrinsics, if any, are in `intrinsics.txt`.

    depth_scale: metres per unit, max_depth: farther depth [m] counts as missing; both as in
    `read_depth`, for ground truth and sparse depth alike.

    Raises FileFormatError if a folder is missing or a frame lacks one of its files.
    """

    path: Path
    depth_scale: float | None = None
    max_depth: float | None = None
    name: ClassVar[str] = "folder"

    def __post_init__(self) -> None:
        images, *depths = self._files
        for depth in depths:
            lone = sorted(images.keys() ^ depth.keys())
            if lone:
                raise FileFormatError(
                    f"{self.path}: {len(lone)} frames lack an image or a depth map, "
                    f"first {lone[0]!r}; each needs one file of the same name in every folder"
                )

    @cached_property
    def _files(self) -> tuple[dict[str, Path], ...]:
        """Images, ground truth and, where there is one, sparse depth, by frame id."""
        if not (self.path / "rgb").is_dir() and any(self.path.glob("*/rgb.*")):
            images = self._from_subfolders("rgb", IMAGE_SUFFIXES)
            return images, self._from_subfolders("depth", DEPTH_SUFFIXES)
        truth = "gt" if (self.path / "gt").is_dir() else "depth"
        folders = [("rgb", IMAGE_SUFFIXES), (truth, DEPTH_SUFFIXES)]
        if (self.path / "sparse").is_dir():
            folders.append(("sparse", DEPTH_SUFFIXES))
        return tuple(files_by_stem(self.path / name, suffixes) for name, suffixes in folders)

    def _from_subfolders(self, stem: str, suffixes: Sequence[str]) -> dict[str, Path]:
        """The files of this name in the subfolders, by the names of those."""
        found = {
            folder.name: files_by_stem(folder, suffixes).get(stem)
            for folder in sorted(self.path.iterdir())
            if folder.is_dir()
        }
        return {frame_id: path for frame_id, path in found.items() if path is not None}

    @cached_property
    def frame_ids(self) -> tuple[str, ...]:
        return tuple(sorted(self._files[0]))

    def load(self, frame_id: str) -> Sample:
        image_path, *depth_paths = (files[frame_id] for files in self._files)
        image = read_image(image_path).pixels
        depths = [
            read_depth(path, depth_scale=self.depth_scale, max_depth=self.max_depth)
            for path in depth_paths
        ]
        for path, depth in zip(depth_paths, depths, strict=True):
            check_sizes(path, image, depth.depth)
        truth, sparse = depths[0], depths[1] if len(depths) > 1 else None
        own = image_path.with_name("intrinsics.txt")
        intrinsics = own if own.is_file() else self.path / "K.txt"
        K = read_intrinsics(intrinsics).K if intrinsics.is_file() else None
        frame = make_frame(
            image,
            None if sparse is None else sparse.depth,
            None if sparse is None else sparse.valid_mask,
            K=K,
            id=frame_id,
        )
        return Sample(frame=frame, metric_depth=truth.depth, metric_mask=truth.valid_mask)
