"""K of 1920x1080 for an image of 640x480, and a normalised K, made wrong clouds in silence."""

import pytest

from steered_marigold.errors import InputError
from steered_marigold.io.intrinsics import read_intrinsics

SIZE = (480, 640)


def test_a_principal_point_outside_is_refused() -> None:
    with pytest.raises(InputError, match="outside the 640x480"):
        read_intrinsics("1380,1380,960,540").for_image(SIZE)


def test_a_known_size_is_scaled() -> None:
    K, notes = read_intrinsics("1380,1380,960,720,1920,1440").for_image(SIZE)
    assert K[0, 0] == 460
    assert notes[0].kind == "intrinsics_scaled"


def test_normalised() -> None:
    K, notes = read_intrinsics("0.72,0.96,0.5,0.5").for_image(SIZE)
    assert K.flatten().tolist() == pytest.approx([460.8, 0, 319.5, 0, 460.8, 239.5, 0, 0, 1])
    assert notes[0].kind == "intrinsics_scaled"
