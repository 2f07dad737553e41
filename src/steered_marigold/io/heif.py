"""HEIC files of phones: the picture, and the depth that some of them hold beside it."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from steered_marigold.errors import FileFormatError, MissingExtraError
from steered_marigold.io.files import decoding, require_pixel_count

HEIF_SUFFIXES = (".heic", ".heif")
# how ISO/IEC 14496-15 and 23008-2 number the meanings of a depth map's codes
_INVERSE_Z, _LINEAR_Z = 0, 2


def open_heif(path: Path) -> Image.Image:
    """The picture, turned as the file says. MissingExtraError without pillow-heif."""
    heif = _open(path)
    with decoding(path):
        return heif.to_pillow()  # type: ignore[no-any-return]


def read_heif_depth(path: Path) -> NDArray[np.float32]:
    """Depth [m] beside the picture: [height, width], 0 where it is not finite.

    Raises FileFormatError where there is none, or only relative depth, as in most portraits.
    """
    depths = [depth for depth in _open(path).info.get("depth_images", []) if depth is not None]
    if not depths:
        raise FileFormatError(
            f"{path}: holds no depth map; export the depth of the capture app as 16-bit PNG or .npy"
        )
    codes = np.asarray(depths[0].to_pillow())
    return heif_metres(path, codes, depths[0].info.get("metadata") or {})


def heif_metres(path: Path, codes: NDArray[Any], metadata: dict[str, Any]) -> NDArray[np.float32]:
    """Depth [m] from codes over their full range and the near and far limits of the metadata.

    Raises FileFormatError unless the metadata say what the codes mean in metres.
    """
    share = codes.astype(np.float64) / np.iinfo(codes.dtype).max
    kind = metadata.get("representation_type")
    near, far = metadata.get("z_near"), metadata.get("z_far")
    low, high = metadata.get("d_min"), metadata.get("d_max")
    if kind == _LINEAR_Z and near is not None and far is not None:
        return np.asarray(near + share * (far - near), np.float32)
    if kind == _INVERSE_Z and near and far:
        low, high = 1 / far, 1 / near
    if kind == _INVERSE_Z and low is not None and high is not None and high > low >= 0:
        inverse = low + share * (high - low)
        depth = np.divide(1, inverse, out=np.zeros_like(inverse), where=inverse > 0)
        return np.asarray(depth, np.float32)
    raise FileFormatError(
        f"{path}: its depth map has no metres (its codes are relative); capture depth in metres "
        "with an app that exports 16-bit PNG or .npy"
    )


def _open(path: Path) -> Any:
    try:
        import pillow_heif
    except ImportError as error:
        raise MissingExtraError("heif", "pillow-heif") from error
    with decoding(path):
        heif = pillow_heif.open_heif(path)
        require_pixel_count(path, *heif.size)
        return heif
