"""Fixtures that several test folders share."""

from pathlib import Path

import pytest
from hypothesis import settings

from tests.frames.completers import NearestCompleter, SilentCompleter, write_frame

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"

# times vary too much between machines to say anything about a law
settings.register_profile("shared", deadline=None)
settings.load_profile("shared")


def _folder(name: str) -> Path:
    if not (DATA / name).is_dir():
        pytest.skip(f"{DATA / name} is not on this machine")
    return DATA / name


@pytest.fixture(scope="session")
def real_frames() -> Path:
    """Real sensor frames with real holes."""
    return _folder("real_frames")


@pytest.fixture(scope="session")
def nyuv2_train() -> Path:
    """The NYUv2 training frames."""
    return _folder("nyuv2_train")


@pytest.fixture
def completer() -> NearestCompleter:
    """A completer with uncertainty."""
    return NearestCompleter()


@pytest.fixture
def silent_completer() -> SilentCompleter:
    """A completer without uncertainty."""
    return SilentCompleter()


@pytest.fixture
def frame_files(tmp_path: Path) -> tuple[Path, Path]:
    """An image and its half empty depth map."""
    write_frame(tmp_path / "image.png", tmp_path / "depth.png", seed=0)
    return tmp_path / "image.png", tmp_path / "depth.png"


@pytest.fixture
def frame_folders(tmp_path: Path) -> tuple[Path, Path]:
    """Two folders with three frames."""
    images, depths = tmp_path / "images", tmp_path / "depths"
    images.mkdir()
    depths.mkdir()
    for index in range(3):
        write_frame(images / f"{index:04d}.png", depths / f"{index:04d}.png", seed=index)
    return images, depths


@pytest.fixture(scope="session")
def sequence() -> Path:
    """Consecutive real frames, and two of which the depth is not registered."""
    return _folder("sequence")


@pytest.fixture(scope="session")
def rgbd() -> Path:
    """RGB-D pairs of other sources."""
    return _folder("rgbd")
