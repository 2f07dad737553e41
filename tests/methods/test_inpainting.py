from typing import Literal

import cv2
import numpy as np
import pytest
import torch
from jaxtyping import Bool, Float, UInt8

from steered_marigold.errors import InputError
from steered_marigold.methods.inpainting import ColorizationCompleter, OpenCvInpainter

Algorithm = Literal["telea", "navier-stokes"]
each_algorithm = pytest.mark.parametrize("algorithm", ["telea", "navier-stokes"])


def sample(
    height: int, width: int, *, fraction: float
) -> tuple[
    UInt8[torch.Tensor, "height width 3"],
    Float[torch.Tensor, "height width"],
    Bool[torch.Tensor, "height width"],
]:
    generator = torch.Generator().manual_seed(0)
    image = torch.randint(0, 256, (height, width, 3), dtype=torch.uint8, generator=generator)
    depth = 0.5 + 8 * torch.rand(height, width, generator=generator)
    return image, depth, torch.rand(height, width, generator=generator) < fraction


@each_algorithm
def test_keeps_measured_pixels_and_fills_a_plane(algorithm: Algorithm) -> None:
    y, x = torch.meshgrid(torch.arange(60.0), torch.arange(80.0), indexing="ij")
    plane = 1 + 0.02 * x + 0.01 * y
    image, _, mask = sample(60, 80, fraction=0.5)
    filled = OpenCvInpainter(algorithm).complete(image, plane, mask).depth[0]
    assert torch.equal(filled[mask], plane[mask])
    assert (filled - plane).abs().max() < 0.07  # what the plane climbs within the radius


@each_algorithm
def test_does_not_quantise_or_drift(algorithm: Algorithm) -> None:
    """Eight bits would round 2.3456 m to 9 mm; OpenCV's Telea adds about 1 a pixel in metres."""
    image, _, mask = sample(100, 100, fraction=0.0)
    mask[:, 0] = True
    filled = OpenCvInpainter(algorithm).complete(image, torch.full((100, 100), 2.3456), mask).depth
    assert (filled - 2.3456).abs().max() < 5e-4


def test_a_larger_radius_averages_more() -> None:
    image, depth, mask = sample(40, 40, fraction=0.3)
    small, large = (
        OpenCvInpainter("navier-stokes", radius_px=radius).complete(image, depth, mask).depth[0]
        for radius in (1.0, 10.0)
    )
    assert large[~mask].std() < small[~mask].std()


def test_refuses_an_impossible_radius() -> None:
    with pytest.raises(InputError, match="radius_px"):
        OpenCvInpainter("telea", radius_px=0.0)


def toolbox_colorization(
    grey: Float[np.ndarray, "height width"],
    depth: Float[np.ndarray, "height width"],
    mask: Bool[np.ndarray, "height width"],
) -> Float[np.ndarray, "height width"]:
    """The NYU toolbox's definition, one pixel at a time, with a dense solve."""
    height, width = grey.shape
    system = np.eye(grey.size)
    for y in range(height):
        for x in range(width):
            centre = y * width + x
            window = [
                (j, i)
                for j in range(max(0, y - 1), min(height, y + 2))
                for i in range(max(0, x - 1), min(width, x + 2))
            ]
            variance = np.var([grey[at] for at in window])
            window.remove((y, x))
            squared = np.array([(grey[at] - grey[y, x]) ** 2 for at in window])
            spread = max(0.6 * variance, squared.min() / -np.log(0.01), 2e-6)
            weights = np.exp(-squared / spread)
            for (j, i), weight in zip(window, weights / weights.sum(), strict=True):
                system[centre, j * width + i] -= weight
            system[centre, centre] += mask[y, x]
    return np.linalg.solve(system, (mask * depth).ravel()).reshape(grey.shape)


@pytest.mark.parametrize("constant_image", [False, True])
def test_colorization_equals_the_toolbox_definition(constant_image: bool) -> None:
    image, depth, mask = sample(13, 17, fraction=0.1)
    if constant_image:
        image[:] = 128
    grey = cv2.cvtColor(image.numpy().astype(np.float32) / 255, cv2.COLOR_RGB2GRAY)
    expected = toolbox_colorization(grey.astype(np.float64), depth.numpy(), mask.numpy())
    filled = ColorizationCompleter().complete(image, depth, mask).depth[0]
    np.testing.assert_allclose(filled.numpy(), expected, rtol=1e-5)


def test_colorization_stops_at_image_edges() -> None:
    image = torch.zeros(40, 60, 3, dtype=torch.uint8)
    image[:, 30:] = 200
    depth = torch.where(image[..., 0] > 0, 6.0, 2.0)
    mask = torch.zeros(40, 60, dtype=torch.bool)
    mask[::8, 4] = mask[::8, 55] = True
    filled = ColorizationCompleter().complete(image, depth, mask).depth[0]
    assert (filled[:, :29] - 2).abs().max() < 0.3
    assert (filled[:, 31:] - 6).abs().max() < 0.3
