"""The real sequence, where it is on this machine."""

from pathlib import Path

import pytest

from tests.conftest import DATA


@pytest.fixture(scope="session")
def sequence() -> Path:
    """120 consecutive frames of a Kinect with poses."""
    if not (DATA / "sequence").is_dir():
        pytest.skip(f"{DATA / 'sequence'} is not on this machine")
    return DATA / "sequence"
