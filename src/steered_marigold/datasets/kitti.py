"""KITTI depth completion (Uhrig et al., 3DV 2017): the 1000 frames of val_selection_cropped."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import ClassVar

from jaxtyping import UInt8
from torch import Tensor

from steered_marigold.core.frame import make_frame
from steered_marigold.datasets.dataset import check_sizes, files_by_stem
from steered_marigold.datasets.sample import Sample
from steered_marigold.errors import FileFormatError
from steered_marigold.io.depth_maps import DepthMap, read_depth
from steered_marigold.io.images import read_image
from steered_marigold.io.intrinsics import read_intrinsics

DEPTH_SCALE = 1 / 256
URL = "https://www.cvlibs.net/datasets/kitti/eval_depth.php?benchmark=depth_completion"


@dataclass(frozen=True)
class KittiSelection:
    """`val_selection_cropped`: image/, velodyne_raw/, groundtruth_depth/ and intrinsics/.

    Depth is uint16 in 1/256 m, 0 = not measured. The ground truth accumulates 11 scans; the sparse
    depth is one scan of 64 lines. Frame ids are the names in image/, such as
    "2011_09_26_drive_0002_sync_image_0000000005_image_02".

    Raises FileFormatError if image/ is missing or holds no PNG.
    """

    path: Path
    name: ClassVar[str] = "kitti"

    def __post_init__(self) -> None:
        if not self.frame_ids:
            raise FileFormatError(
                f"{self.path / 'image'}: holds no frames; get the manually selected validation "
                f"data from {URL} and name its folder val_selection_cropped"
            )

    @cached_property
    def frame_ids(self) -> tuple[str, ...]:
        return tuple(sorted(files_by_stem(self.path / "image", (".png",))))

    def load(self, frame_id: str) -> Sample:
        image = read_image(self.path / "image" / f"{frame_id}.png").pixels
        truth = self._depth("groundtruth_depth", frame_id, image)
        scan = self._depth("velodyne_raw", frame_id, image)
        K = read_intrinsics(self.path / "intrinsics" / f"{frame_id}.txt").K
        frame = make_frame(image, scan.depth, scan.valid_mask, K=K, id=frame_id)
        return Sample(frame=frame, metric_depth=truth.depth, metric_mask=truth.valid_mask)

    def _depth(
        self, folder: str, frame_id: str, image: UInt8[Tensor, "height width 3"]
    ) -> DepthMap:
        """Depth maps have the name of their folder in the place of the first "image"."""
        path = self.path / folder / f"{frame_id.replace('_image_', f'_{folder}_', 1)}.png"
        depth_map = read_depth(path, depth_scale=DEPTH_SCALE)
        check_sizes(path, image, depth_map.depth)
        return depth_map
