"""NYU Depth v2 (Silberman et al., ECCV 2012): the 1449 labelled frames.

Kinect frames of 640x480 in the official orientation. `raw` ground truth is what the sensor gave,
projected into the colour camera; `inpainted` is the toolbox's colorization of it (dense).
"""

from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files
from pathlib import Path
from typing import ClassVar

import torch

from steered_marigold.datasets.hdf5 import open_hdf5, sample_from_arrays
from steered_marigold.datasets.sample import Sample
from steered_marigold.errors import FileFormatError, InputError

URL = "http://horatio.cs.nyu.edu/mit/silberman/nyu_depth_v2/nyu_depth_v2_labeled.mat"
GROUND_TRUTHS = {"raw": "rawDepths", "inpainted": "depths"}
SPLITS = ("test", "train", "all")

_FRAMES = 1449
# The toolbox's camera_params.m. Its depth_plane2depth_world.m and rgb_plane2rgb_world.m take the
# principal point at pixels counted from 1 (meshgrid(1:W, 1:H)), and project_depth_map.m indexes
# MATLAB's arrays with what it projects: counted from 0, it is 1 less. BP-Net's data loader and most
# others in Python leave out the 1, which moves points by depth / 519 sideways.
_K = torch.tensor(
    [
        [518.85790117450188, 0, 325.58244941119034 - 1],
        [0, 519.46961112127485, 253.73616633400465 - 1],
        [0, 0, 1],
    ]
)


def split_indices(split: str) -> tuple[int, ...]:
    """0-based indices of the official split: 795 to train, 654 to test; or all 1449.

    Raises InputError for another name.
    """
    text = files("steered_marigold.datasets").joinpath("nyuv2_train.txt").read_text("utf-8")
    train = {int(line) for line in text.split()}
    if split == "train":
        return tuple(sorted(train))
    if split == "test":
        return tuple(index for index in range(_FRAMES) if index not in train)
    if split == "all":
        return tuple(range(_FRAMES))
    raise InputError(f"split {split!r} of NYUv2 is not known; use one of {', '.join(SPLITS)}")


@dataclass(frozen=True)
class Nyuv2:
    """`nyu_depth_v2_labeled.mat`, read frame by frame; frame ids are 0-based indices in it.

    split: "test", "train" or "all". ground_truth: "raw" (the paper's) or "inpainted".

    Raises FileFormatError if the file is missing or damaged, InputError for an unknown split or
    ground truth, MissingExtraError without h5py.
    """

    path: Path
    split: str = "test"
    ground_truth: str = "raw"
    name: ClassVar[str] = "nyuv2"

    def __post_init__(self) -> None:
        if self.ground_truth not in GROUND_TRUTHS:
            raise InputError(
                f"ground truth {self.ground_truth!r} is not known; use raw or inpainted"
            )
        split_indices(self.split)
        depths = GROUND_TRUTHS[self.ground_truth]
        try:
            with open_hdf5(self.path, ("images", depths)) as file:
                shapes = file["images"].shape, file[depths].shape
        except FileFormatError as error:
            raise FileFormatError(f"{error}; get it from {URL} (2.8 GB)") from error
        if shapes != ((_FRAMES, 3, 640, 480), (_FRAMES, 640, 480)):
            raise FileFormatError(
                f"{self.path}: images and {depths} have shapes {shapes}, not those of "
                f"{_FRAMES} frames of 640x480 px; get it from {URL} (2.8 GB)"
            )

    @cached_property
    def frame_ids(self) -> tuple[str, ...]:
        return tuple(f"{index:04d}" for index in split_indices(self.split))

    def load(self, frame_id: str) -> Sample:
        depths = GROUND_TRUTHS[self.ground_truth]
        with open_hdf5(self.path, ("images", depths)) as file:
            # MATLAB stores columns first
            image = file["images"][int(frame_id)].transpose(2, 1, 0)
            depth = file[depths][int(frame_id)].T
        return sample_from_arrays(self.path, frame_id, image, depth, _K)


@dataclass(frozen=True)
class Nyuv2H5:
    """The HDF5 folders of sparse-to-dense (Ma & Karaman, ICRA 2018), which BP-Net and others use.

    Every .h5 file below `path` is a frame of 640x480 px: `rgb` uint8 [3, 480, 640], `depth` float32
    [480, 640] in metres. Frame ids are paths without the extension. Give the folder of one split
    (`val` holds the 654 official test frames).

    Raises FileFormatError if the folder holds no such file, MissingExtraError without h5py.
    """

    path: Path
    name: ClassVar[str] = "nyuv2-h5"

    def __post_init__(self) -> None:
        if not self.frame_ids:
            raise FileFormatError(f"{self.path}: holds no .h5 file, at any depth")

    @cached_property
    def frame_ids(self) -> tuple[str, ...]:
        found = self.path.rglob("*.h5")
        return tuple(
            sorted(file.relative_to(self.path).with_suffix("").as_posix() for file in found)
        )

    def load(self, frame_id: str) -> Sample:
        path = self.path / f"{frame_id}.h5"
        with open_hdf5(path, ("rgb", "depth")) as file:
            image = file["rgb"][:].transpose(1, 2, 0)
            depth = file["depth"][:]
        return sample_from_arrays(path, frame_id, image, depth, _K)
