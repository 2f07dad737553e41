"""Data sets by name."""

from pathlib import Path

from steered_marigold.datasets.dataset import Dataset
from steered_marigold.datasets.folder import FrameFolder
from steered_marigold.datasets.kitti import KittiSelection
from steered_marigold.datasets.nyuv2 import Nyuv2, Nyuv2H5
from steered_marigold.errors import InputError

DATASETS = ("nyuv2", "nyuv2-h5", "kitti", "folder", "recording")


def open_dataset(
    name: str,
    path: Path,
    *,
    split: str = "test",
    ground_truth: str = "raw",
    depth_scale: float | None = None,
    max_depth: float | None = None,
) -> Dataset:
    """One of DATASETS. split and ground_truth are read for nyuv2, the depth options for folder.

    Raises InputError for an unknown name, and what the data set raises.
    """
    if name == "nyuv2":
        return Nyuv2(path, split=split, ground_truth=ground_truth)
    if name == "nyuv2-h5":
        return Nyuv2H5(path)
    if name == "kitti":
        return KittiSelection(path)
    if name == "folder":
        return FrameFolder(path, depth_scale=depth_scale, max_depth=max_depth)
    if name == "recording":
        from steered_marigold.datasets.recording import RecordingFrames  # needs an extra

        return RecordingFrames(path)
    raise InputError(f"data set {name!r} is not known; use one of {', '.join(DATASETS)}")
