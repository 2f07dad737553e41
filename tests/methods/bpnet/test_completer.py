from functools import partial
from pathlib import Path

import pytest
import torch
from torch import Tensor
from torch.nn import functional as F

from steered_marigold.errors import (
    CheckpointError,
    InputError,
    NoMeasurementsError,
    SizeMismatchError,
)
from steered_marigold.methods.bpnet import BPNet, BPNetCompleter
from steered_marigold.methods.completer import DepthCompleter

K = torch.tensor([[300.0, 0, 150], [0, 310, 120], [0, 0, 1]])


@pytest.fixture(autouse=True)
def narrow(monkeypatch: pytest.MonkeyPatch) -> None:
    """The real network, with fewer channels."""
    monkeypatch.setattr("steered_marigold.methods.bpnet.completer.BPNet", partial(BPNet, width=2))


@pytest.fixture
def weights(tmp_path: Path) -> Path:
    torch.manual_seed(0)
    torch.save({"net": BPNet(width=2).state_dict(), "epoch": 1}, tmp_path / "result_ema.pth")
    return tmp_path / "result_ema.pth"


def frame(height: int, width: int) -> tuple[Tensor, Tensor, Tensor]:
    generator = torch.Generator().manual_seed(1)
    image = torch.randint(256, (height, width, 3), generator=generator, dtype=torch.uint8)
    valid = torch.rand(height, width, generator=generator) < 0.02
    depth = 1 + 4 * torch.rand(height, width, generator=generator)
    return image, torch.where(valid, depth, torch.nan), valid


def test_nyuv2_frames_are_prepared_as_its_authors_did(weights: Path) -> None:
    image, depth, valid = frame(228, 304)
    network = BPNet(width=2).eval()
    network.load_state_dict(torch.load(weights)["net"])
    mean, std = (
        (255 * torch.tensor(values, dtype=torch.float64)).float()
        for values in ([0.485, 0.456, 0.406], [0.229, 0.224, 0.225])
    )
    normalized = ((image - mean) / std).permute(2, 0, 1)[None]
    sparse = F.pad(depth.nan_to_num(0)[None, None], (8, 8, 14, 14)) * 10
    shifted = K + torch.tensor([[0, 0, 8.0], [0, 0, 14], [0, 0, 0]])
    with torch.no_grad():
        expected = network(F.pad(normalized, (8, 8, 14, 14), mode="replicate"), sparse, shifted)
    completer = BPNetCompleter(weights)
    assert isinstance(completer, DepthCompleter)
    completion = completer.complete(image, depth, valid, K)
    torch.testing.assert_close(completion.depth, expected[:, 0, 14:-14, 8:-8] / 10)
    assert torch.equal(completion.measured, valid[None])
    assert torch.equal(completion.trusted, valid[None])


def test_kitti_frames_are_in_metres_with_their_own_colours(weights: Path) -> None:
    image, depth, valid = frame(64, 96)
    network = BPNet(width=2).eval()
    network.load_state_dict(torch.load(weights)["net"])
    mean, std = torch.tensor([90.9950, 96.2278, 94.3213]), torch.tensor([79.2382, 80.5267, 82.1483])
    with torch.no_grad():
        expected = network(
            ((image - mean) / std).permute(2, 0, 1)[None], depth.nan_to_num(0)[None, None], K
        )
    completion = BPNetCompleter(weights, trained_on="kitti").complete(image, depth, valid, K)
    torch.testing.assert_close(completion.depth, expected[:, 0])


@pytest.mark.parametrize(("height", "width"), [(33, 64), (50, 47)])
def test_any_size(height: int, width: int, weights: Path) -> None:
    completion = BPNetCompleter(weights).complete(*frame(height, width), K)
    assert completion.depth.shape == (1, height, width)
    assert completion.depth.isfinite().all()


def test_bad_input(weights: Path) -> None:
    image, depth, valid = frame(32, 32)
    completer = BPNetCompleter(weights)
    with pytest.raises(InputError, match="give it K"):
        completer.complete(image, depth, valid)
    with pytest.raises(NoMeasurementsError, match="bpnet"):
        completer.complete(image, depth, torch.zeros_like(valid), K)
    with pytest.raises(InputError, match="`sparse_depth` must be finite and positive"):
        completer.complete(image, torch.zeros_like(depth), valid, K)
    with pytest.raises(SizeMismatchError, match=r"\[32, 32\] but the image \[32, 31\]"):
        completer.complete(image[:, :31], depth, valid, K)
    with pytest.raises(CheckpointError, match="does not exist"):
        BPNetCompleter(weights.with_name("other.pth"))
