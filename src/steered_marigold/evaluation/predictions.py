"""The answers of a run, kept as pictures of depth."""

from pathlib import Path
from urllib.parse import quote

from jaxtyping import Float
from torch import Tensor

from steered_marigold.datasets.kitti import DEPTH_SCALE as KITTI_SCALE
from steered_marigold.errors import FileFormatError
from steered_marigold.evaluation.settings import RunSettings
from steered_marigold.io.depth_encodings import MILLIMETRE
from steered_marigold.io.depth_maps import read_depth, write_depth
from steered_marigold.io.files import create_folder

_LARGEST_CODE = 65534  # one below what sensors write for "out of range"


class Predictions:
    """`predictions/METHOD/FRAME.png` in a run's folder, 16 bits.

    Values are millimetres, of KITTI 1/256 m as in its own files. Depth that is not positive is 0,
    depth beyond 65.5 m (KITTI: 256 m) is that. In names, characters that some file system does not
    take are percent-encoded, as in URLs.
    """

    def __init__(self, settings: RunSettings, folder: Path) -> None:
        self.folder = folder / "predictions"
        self._scale = KITTI_SCALE if settings.dataset == "kitti" else MILLIMETRE

    def path(self, label: str, frame_id: str) -> Path:
        """Where the answer of a method to a frame is kept."""
        return self.folder / quote(label, safe="@=,") / f"{quote(frame_id, safe='')}.png"

    def folders(self) -> list[Path]:
        """One for each method that there is."""
        return [path for path in self.folder.glob("*") if path.is_dir()]

    def write(self, label: str, frame_id: str, depth: Float[Tensor, "height width"]) -> None:
        """Keeps depth [m]; the file is whole or absent."""
        path = self.path(label, frame_id)
        create_folder(path.parent)
        farthest = _LARGEST_CODE * self._scale
        write_depth(path, depth.clamp(0, farthest), output_scale=self._scale)

    def read(self, label: str, frame_id: str) -> Float[Tensor, "height width"] | None:
        """Depth [m], or None if it was not kept or its file is damaged."""
        try:
            return read_depth(self.path(label, frame_id), depth_scale=self._scale).depth
        except FileFormatError:
            return None
