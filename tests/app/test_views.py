"""Pictures and numbers that the page is given."""

import base64
import zlib
from io import BytesIO
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from steered_marigold.app.views import LONGEST_SIDE, canvas_view, completed_view, frame_view
from steered_marigold.core.completion import DepthCompletion
from steered_marigold.core.frame import Frame, make_frame
from steered_marigold.pictures.colours import DEPTH, robust_range


def frame_of(height: int = 20, width: int = 30) -> Frame:
    """Depth grows from 1 to 4 m to the right; the upper half is missing."""
    depth = np.tile(np.linspace(1, 4, width, dtype=np.float32), (height, 1))
    depth[: height // 2] = 0
    image = np.full((height, width, 3), 90, np.uint8)
    return make_frame(image, depth)


def completion_of(frame: Frame, sigma: float | None = 0.1) -> DepthCompletion:
    dense = torch.linspace(1, 4, frame.size[1]).expand(frame.size)[None]
    return DepthCompletion(
        depth=dense,
        measured=frame.valid_mask[None],
        trusted=frame.valid_mask[None],
        uncertainty=None if sigma is None else torch.full_like(dense, sigma),
    )


def unpacked(packed: dict[str, Any], width: int) -> np.ndarray:
    """As viewer.js does it."""
    codes = np.frombuffer(zlib.decompress(base64.b64decode(packed["data"])), "<u2")
    return np.where(codes > 0, codes * packed["scale"], np.nan).reshape(-1, width)


def picture(view: dict[str, Any]) -> Image.Image:
    return Image.open(BytesIO(base64.b64decode(view["src"].partition(",")[2]))).convert("RGB")


def colour(view: dict[str, Any], column: int, row: int) -> list[int]:
    """RGB of a pixel of a picture."""
    return np.asarray(picture(view))[row, column].tolist()  # type: ignore[no-any-return]


def test_the_numbers_under_the_cursor_are_those_of_the_result() -> None:
    frame = frame_of()
    view = completed_view(frame, completion_of(frame))
    measured = unpacked(view["maps"]["measured"], view["width"])
    depth = unpacked(view["maps"]["depth"], view["width"])
    known = frame.valid_mask.numpy()
    assert np.isnan(measured[~known]).all()
    np.testing.assert_allclose(measured[known], frame.sparse_depth.numpy()[known], atol=1e-4)
    np.testing.assert_allclose(depth, np.tile(np.linspace(1, 4, 30), (20, 1)), atol=1e-4)
    np.testing.assert_allclose(unpacked(view["maps"]["sigma"], 30), 0.1, atol=1e-5)


@given(largest=st.floats(1e-3, 1e5), share=st.floats(0.01, 1))
def test_packed_numbers_are_exact_to_a_65535th_of_the_largest(largest: float, share: float) -> None:
    frame = frame_of()
    depth = torch.full(frame.size, largest * share)
    depth[0, 0] = largest
    mask = frame.valid_mask
    view = completed_view(
        frame, DepthCompletion(depth=depth[None], measured=mask[None], trusted=mask[None])
    )
    error = np.abs(unpacked(view["maps"]["depth"], 30) - depth.numpy())
    assert error.max() <= largest / 65535 * 1.01


def test_all_depths_have_one_colour_scale() -> None:
    frame = frame_of()
    view = completed_view(frame, completion_of(frame))
    titles = [p["title"] for p in view["pictures"]]
    assert titles == ["Image", "Input, 50.0% measured", "Result", "Uncertainty"]
    given_, result = view["pictures"][1], view["pictures"][2]
    assert given_["bar"] == result["bar"]
    assert result["bar"]["unit"] == "m"
    scale = robust_range(completion_of(frame).depth[0].numpy())
    for column in (0, 12, 29):
        exact = np.array(DEPTH(scale(1 + 3 * column / 29))[:3]) * 255
        np.testing.assert_allclose(colour(result, column, 15), exact, atol=6)
        assert colour(given_, column, 15) == colour(result, column, 15)
    assert colour(given_, 5, 2) == [128, 128, 128]


def test_the_error_is_shown_where_measurements_were_hidden() -> None:
    truth = frame_of()
    hidden = torch.zeros(truth.size, dtype=torch.bool)
    hidden[15:, :10] = True
    view = completed_view(truth.keep(~hidden), completion_of(truth), truth)
    assert view["pictures"][-1]["title"] == "Error in the hole"
    was = unpacked(view["maps"]["was"], 30)
    np.testing.assert_array_equal(np.isfinite(was), (hidden & truth.valid_mask).numpy())


def test_a_frame_without_a_result_and_a_result_without_uncertainty_are_shown() -> None:
    frame = frame_of()
    assert [p["title"].split(",")[0] for p in frame_view(frame)["pictures"]] == ["Image", "Input"]
    view = completed_view(frame, completion_of(frame, sigma=None))
    assert "sigma" not in view["maps"]


def test_large_frames_are_thinned_alike() -> None:
    frame = frame_of(30, 2 * LONGEST_SIDE + 10)
    view = completed_view(frame, completion_of(frame))
    assert view["step"] == 3
    assert max(view["width"], view["height"]) <= LONGEST_SIDE
    for shown in view["pictures"]:
        assert picture(shown).size == (view["width"], view["height"])
    depth = unpacked(view["maps"]["depth"], view["width"])
    np.testing.assert_allclose(depth[0, 100], frame_depth(frame, 300), atol=1e-3)


def frame_depth(frame: Frame, column: int) -> float:
    return float(completion_of(frame).depth[0, 0, column])


def test_relative_depth_has_no_metres() -> None:
    image = np.full((8, 10, 3), 90, np.uint8)
    frame = make_frame(image)
    depth = torch.rand(1, 8, 10)
    nothing = torch.zeros(1, 8, 10, dtype=torch.bool)
    relative = DepthCompletion(depth=depth, measured=nothing, trusted=nothing, metric=False)
    view = completed_view(frame, relative)
    assert view["unit"] == "relative"
    assert view["pictures"][2]["bar"]["high"] == pytest.approx(1)


def test_holes_are_drawn_on_the_image_coloured_where_depth_is() -> None:
    frame = frame_of()
    canvas = canvas_view(frame)
    np.testing.assert_allclose(colour(canvas, 15, 3), 90, atol=8)
    assert np.ptp(colour(canvas, 15, 15)) > 40
