"""What the HDF5 data sets share; h5py is an optional dependency."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor

from steered_marigold.core.frame import make_frame
from steered_marigold.datasets.dataset import check_sizes
from steered_marigold.datasets.sample import Sample
from steered_marigold.errors import FileFormatError, MissingExtraError
from steered_marigold.io.files import decoding, require_file


@contextmanager
def open_hdf5(path: Path, keys: tuple[str, ...]) -> Iterator[Any]:
    """The opened file, an `h5py.File` that holds the data sets `keys`.

    Raises FileFormatError if it is missing or damaged or lacks one of the keys, also for whatever
    fails inside the block; MissingExtraError without h5py.
    """
    try:
        import h5py  # an extra
    except ImportError as error:
        raise MissingExtraError("eval", "h5py") from error
    with decoding(require_file(path)), h5py.File(path, "r") as file:
        absent = [key for key in keys if key not in file]
        if absent:
            raise FileFormatError(f"{path}: holds no {absent[0]!r}; is it the right file?")
        yield file


def sample_from_arrays(
    where: Path,
    frame_id: str,
    image: UInt8[np.ndarray, "height width 3"],
    depth: Float[np.ndarray, "depth_height depth_width"],
    K: Float[Tensor, "3 3"],
) -> Sample:
    """A frame from its arrays; depth that is zero, negative or not finite was not measured.

    Raises SizeMismatchError, naming `where`, if they differ in size.
    """
    pixels, metres = (torch.from_numpy(np.ascontiguousarray(x)) for x in (image, depth))
    check_sizes(where, pixels, metres)
    truth = make_frame(pixels, metres, K=K, id=frame_id)
    nothing = torch.zeros_like(truth.valid_mask)
    return Sample(
        frame=truth.keep(nothing), metric_depth=truth.sparse_depth, metric_mask=truth.valid_mask
    )
