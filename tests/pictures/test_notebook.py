"""Completions in notebooks."""

import base64
import re
from dataclasses import replace
from html.parser import HTMLParser
from io import BytesIO

import numpy as np
import pytest
import torch
from PIL import Image

from steered_marigold.core.completion import DepthCompletion

_VOID = {"img"}


class _Strict(HTMLParser):
    """Asserts that every element is closed, in order; keeps what the pictures' `src` are."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.sources: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.sources += [value or "" for name, value in attrs if name in ("src", "href")]
        if tag not in _VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def _completion(height: int = 480, width: int = 640, images: int = 1) -> DepthCompletion:
    noise = torch.rand(images, height, width, generator=torch.Generator().manual_seed(0))
    measured = noise > 0.5
    trusted = measured.clone()
    trusted[:, 0] = False
    return DepthCompletion(
        depth=1 + 3 * noise, measured=measured, trusted=trusted, uncertainty=noise / 10
    )


def _parsed(html: str) -> _Strict:
    parser = _Strict()
    parser.feed(html)
    parser.close()
    assert parser.open == []
    return parser


def test_html_is_whole_and_small_and_fetches_nothing() -> None:
    html = _completion()._repr_html_()  # of noise, which compresses worst
    (source,) = _parsed(html).sources
    assert len(html) < 500_000
    kind, _, data = source.partition(",")
    assert kind == "data:image/jpeg;base64"
    picture = Image.open(BytesIO(base64.b64decode(data, validate=True)))
    assert picture.width > 2 * picture.height
    assert np.asarray(picture).std() > 10
    assert "http" not in html


def test_html_tells_the_numbers_and_repr_the_same_ones() -> None:
    completion = _completion()
    html, short = completion._repr_html_(), repr(completion)
    refused = int((completion.measured & ~completion.trusted).sum())
    numbers = dict(re.findall(r"<th[^>]*>([^<]*)</th><td[^>]*>([^<]*)</td>", html))
    assert numbers["size"] == "1 x 640x480 px"
    assert numbers["depth"] == "1.00 to 4.00 m"
    assert numbers["measured"] == f"{float(completion.measured.float().mean()):.1%}"
    assert numbers["not believed"] == f"{refused:,} px"
    assert float(numbers["median uncertainty"].removesuffix(" m")) == pytest.approx(0.05, abs=1e-3)
    assert all(f"{name} {value}" in short for name, value in numbers.items())
    assert "\n" not in short
    assert len(short) < 200


def test_a_batch_without_uncertainty_or_metres_is_shown_too() -> None:
    relative = replace(
        _completion(30, 40, images=2), uncertainty=None, metric=False, depth=torch.rand(2, 30, 40)
    )
    html = relative._repr_html_()
    assert "2 x 40x30 px" in html
    assert "relative" in html
    assert " m</td>" not in html
    assert len(_parsed(html).sources) == 1
