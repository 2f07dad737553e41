"""What holds for every method without weights."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from torch import Tensor

from steered_marigold.errors import NoMeasurementsError
from steered_marigold.methods.classical import ClassicalCompleter
from steered_marigold.methods.completer import DepthCompleter
from steered_marigold.methods.hole_filling import HoleFillingFilter, SpatialFilter
from steered_marigold.methods.inpainting import ColorizationCompleter, OpenCvInpainter
from steered_marigold.methods.interpolation import LinearCompleter, NearestCompleter
from steered_marigold.methods.ip_basic import IpBasicCompleter

SHAPE = (17, 23)
METHODS = [
    NearestCompleter(),
    LinearCompleter(),
    IpBasicCompleter(),
    OpenCvInpainter("telea"),
    OpenCvInpainter("navier-stokes"),
    ColorizationCompleter(),
    HoleFillingFilter("left"),
    HoleFillingFilter("farthest"),
    HoleFillingFilter("nearest"),
    SpatialFilter(),
]
# it rounds to millimetres
TOLERANCES_M = {"realsense-spatial": 6e-4}
each_method = pytest.mark.parametrize("method", METHODS, ids=lambda method: str(method.name))


def frame(seed: int) -> tuple[Tensor, Tensor]:
    generator = torch.Generator().manual_seed(seed)
    image = torch.randint(0, 256, (*SHAPE, 3), dtype=torch.uint8, generator=generator)
    return image, 0.5 + 8 * torch.rand(SHAPE, generator=generator)


@each_method
def test_satisfies_the_protocol(method: ClassicalCompleter) -> None:
    assert isinstance(method, DepthCompleter)


@each_method
@settings(max_examples=30)
@given(
    mask=arrays.arrays(np.bool_, SHAPE, fill=st.just(False)).filter(np.any), seed=st.integers(0, 9)
)
def test_stays_within_the_measured_range(
    method: ClassicalCompleter, mask: np.ndarray, seed: int
) -> None:
    image, depth = frame(seed)
    measured = torch.from_numpy(mask)
    completion = method.complete(image, torch.where(measured, depth, torch.nan), measured)
    assert completion.depth.shape == (1, *SHAPE)
    tolerance = TOLERANCES_M.get(method.name, 1e-4)
    assert completion.depth.min() >= depth[measured].min() - tolerance
    assert completion.depth.max() <= depth[measured].max() + tolerance
    assert torch.equal(completion.measured[0], measured)


@each_method
@pytest.mark.parametrize("points", [[(3, 4)], [(3, 4), (9, 20)], [(5, x) for x in range(2, 9)]])
def test_one_two_or_collinear_measurements_suffice(
    method: ClassicalCompleter, points: list[tuple[int, int]]
) -> None:
    image, _ = frame(0)
    mask = torch.zeros(SHAPE, dtype=torch.bool)
    for row, column in points:
        mask[row, column] = True
    depth = method.complete(image, torch.full(SHAPE, 2.5), mask).depth
    torch.testing.assert_close(depth, torch.full((1, *SHAPE), 2.5), atol=1e-4, rtol=0)


@each_method
def test_refuses_a_frame_without_measurements(method: ClassicalCompleter) -> None:
    image, depth = frame(0)
    with pytest.raises(NoMeasurementsError, match=method.name):
        method.complete(image, depth, torch.zeros(SHAPE, dtype=torch.bool))
