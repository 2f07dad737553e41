"""RVL against its definition, pixel by pixel."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from steered_marigold.io.bags.rvl import decode_rvl, encode_rvl

pixels = st.lists(
    st.one_of(st.just(0), st.integers(0, 65535), st.integers(1000, 1010)), max_size=80
).map(lambda values: np.array(values, np.uint16))


def _reference(values: NDArray[np.uint16]) -> bytes:
    """The paper's EncodeVLE and CompressRVL, a number after another."""
    groups: list[int] = []

    def number(value: int) -> None:
        while True:
            group, value = value & 7, value >> 3
            groups.append(group | 8 if value else group)
            if not value:
                return

    rest, previous = [int(value) for value in values], 0
    while rest:
        zeros = next((i for i, value in enumerate(rest) if value), len(rest))
        rest = rest[zeros:]
        known = next((i for i, value in enumerate(rest) if not value), len(rest))
        number(zeros)
        number(known)
        for value in rest[:known]:
            step = value - previous
            number(2 * step if step >= 0 else -2 * step - 1)
            previous = value
        rest = rest[known:]
    groups += [0] * (-len(groups) % 8)
    words = [
        sum(group << 28 - 4 * place for place, group in enumerate(groups[i : i + 8]))
        for i in range(0, len(groups), 8)
    ]
    return np.array(words, "<u4").tobytes()


@given(pixels)
def test_the_code_is_that_of_the_paper(values: NDArray[np.uint16]) -> None:
    assert encode_rvl(values) == _reference(values)


@given(pixels)
def test_decoding_undoes_encoding(values: NDArray[np.uint16]) -> None:
    assert np.array_equal(decode_rvl(encode_rvl(values), len(values)), values)


@given(st.binary(max_size=60), st.integers(0, 200))
def test_any_bytes_give_pixels_or_a_value_error(code: bytes, count: int) -> None:
    try:
        assert decode_rvl(code, count).shape == (count,)
    except ValueError as error:
        assert "RVL" in str(error)  # noqa: PT017


def test_a_shortened_code_is_refused() -> None:
    code = encode_rvl(np.arange(1, 200, dtype=np.uint16))
    with pytest.raises(ValueError, match="RVL"):
        decode_rvl(code[: len(code) // 2], 199)
