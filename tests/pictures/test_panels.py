"""The picture for people."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor

from steered_marigold.core.frame import Frame
from steered_marigold.io.files import write_figure
from steered_marigold.pictures.panels import frame_panels

HEIGHT, WIDTH = 48, 64


def _panels(
    *,
    sparse_depth: Tensor | None = None,
    valid_mask: Tensor | None = None,
    depth: Tensor | None = None,
    **rest: Any,
) -> Figure:
    """Of a grey image, by default with a ramp as depth, measured in the left half."""
    ramp = torch.linspace(1, 5, WIDTH).repeat(HEIGHT, 1)
    mask = torch.zeros(HEIGHT, WIDTH, dtype=torch.bool)
    mask[:, : WIDTH // 2] = True
    frame = Frame(
        image=torch.full((HEIGHT, WIDTH, 3), 200, dtype=torch.uint8),
        sparse_depth=ramp if sparse_depth is None else sparse_depth,
        valid_mask=mask if valid_mask is None else valid_mask,
    )
    return frame_panels(frame, ramp if depth is None else depth, **rest)


def _draw(path: Path, **changes: Any) -> NDArray[Any]:
    write_figure(path, _panels(**changes))
    return np.asarray(Image.open(path).convert("RGB")).astype(int)


def _count(picture: NDArray[Any], colour: tuple[int, int, int]) -> int:
    return int((np.abs(picture - colour).max(axis=2) <= 1).sum())


def test_panels_are_added_for_what_is_there(tmp_path: Path) -> None:
    three = _draw(tmp_path / "a.png")
    four = _draw(tmp_path / "b.png", uncertainty=torch.rand(HEIGHT, WIDTH))
    assert four.shape[1] == pytest.approx(three.shape[1] * 4 / 3, abs=2)
    assert _count(three, (200, 200, 200)) >= HEIGHT * WIDTH // 2  # the image is there


def test_missing_pixels_are_grey(tmp_path: Path) -> None:
    half = _count(_draw(tmp_path / "a.png"), (127, 127, 127))
    everything = torch.ones(HEIGHT, WIDTH, dtype=torch.bool)
    none = _count(_draw(tmp_path / "b.png", valid_mask=everything), (127, 127, 127))
    unknown = _count(_draw(tmp_path / "c.png", depth=torch.zeros(HEIGHT, WIDTH)), (127, 127, 127))
    assert none < half < unknown


def test_input_and_result_share_their_colours(tmp_path: Path) -> None:
    everything = torch.ones(HEIGHT, WIDTH, dtype=torch.bool)
    bands = torch.full((HEIGHT, WIDTH), 3.0)
    bands[:2], bands[-2:] = 2.0, 4.0
    picture = _draw(tmp_path / "a.png", sparse_depth=bands, depth=bands, valid_mask=everything)
    colours, counts = np.unique(picture.reshape(-1, 3), axis=0, return_counts=True)
    coloured = np.ptp(colours, axis=1) > 60
    # 3 m has one colour, which fills both panels; the grey image tells a panel's size
    panel = _count(picture, (200, 200, 200)) * (HEIGHT - 4) / HEIGHT
    assert counts[coloured].max() > 1.7 * panel


def test_single_measurements_can_be_seen(tmp_path: Path) -> None:
    mask = torch.zeros(HEIGHT, WIDTH, dtype=torch.bool)
    mask[10::20, 10::20] = True
    grey = _count(_draw(tmp_path / "a.png", valid_mask=mask), (127, 127, 127))
    mask[:] = False
    assert _count(_draw(tmp_path / "b.png", valid_mask=mask), (127, 127, 127)) - grey > 40


def test_relative_depth_and_constant_depth_are_drawn(tmp_path: Path) -> None:
    nothing = torch.zeros(HEIGHT, WIDTH, dtype=torch.bool)
    _draw(tmp_path / "a.png", valid_mask=nothing, depth=torch.zeros(HEIGHT, WIDTH), metric=False)
    _draw(tmp_path / "b.png", depth=torch.full((HEIGHT, WIDTH), 3.0))


def test_the_same_arrays_give_the_same_bytes(tmp_path: Path) -> None:
    _draw(tmp_path / "a.png")
    _draw(tmp_path / "b.png")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_a_picture_is_not_written_by_drawing_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    titles = [axes.get_title() for axes in _panels(uncertainty=torch.rand(HEIGHT, WIDTH)).axes]
    assert titles[0] == "image"
    assert {"input, 50.0% measured", "result"} <= set(titles)
    assert not list(tmp_path.iterdir())
