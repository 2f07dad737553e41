from functools import partial
from pathlib import Path

import pytest
import torch
from torch import Tensor

from steered_marigold.errors import (
    CheckpointError,
    InputError,
    NoMeasurementsError,
    SizeMismatchError,
)
from steered_marigold.methods.completer import DepthCompleter
from steered_marigold.methods.completionformer import CompletionFormer, CompletionFormerCompleter


@pytest.fixture(autouse=True)
def narrow(monkeypatch: pytest.MonkeyPatch) -> None:
    """The real network, with fewer channels."""
    monkeypatch.setattr(
        "steered_marigold.methods.completionformer.completer.CompletionFormer",
        partial(CompletionFormer, width=16),
    )


@pytest.fixture
def weights(tmp_path: Path) -> Path:
    torch.manual_seed(0)
    state = CompletionFormer(width=16).state_dict()
    torch.save({"net": {f"module.{name}": v for name, v in state.items()}}, tmp_path / "NYUv2.pt")
    return tmp_path / "NYUv2.pt"


def frame(height: int, width: int) -> tuple[Tensor, Tensor, Tensor]:
    generator = torch.Generator().manual_seed(1)
    image = torch.randint(256, (height, width, 3), generator=generator, dtype=torch.uint8)
    valid = torch.rand(height, width, generator=generator) < 0.02
    depth = 1 + 4 * torch.rand(height, width, generator=generator)
    return image, torch.where(valid, depth, torch.nan), valid


def test_frames_are_prepared_as_its_authors_did(weights: Path) -> None:
    image, depth, valid = frame(57, 76)
    network = CompletionFormer(width=16).eval()
    state = torch.load(weights)["net"]
    network.load_state_dict({name.removeprefix("module."): v for name, v in state.items()})
    mean, std = torch.tensor([0.485, 0.456, 0.406]), torch.tensor([0.229, 0.224, 0.225])
    with torch.no_grad():
        expected = network(
            ((image / 255 - mean) / std).permute(2, 0, 1)[None], depth.nan_to_num(0)[None, None]
        )
    completer = CompletionFormerCompleter(weights)
    assert isinstance(completer, DepthCompleter)
    completion = completer.complete(image, depth, valid)
    torch.testing.assert_close(completion.depth, expected[:, 0])
    assert torch.equal(completion.measured, valid[None])
    assert torch.equal(completion.trusted, valid[None])


def test_bad_input(weights: Path) -> None:
    image, depth, valid = frame(40, 32)
    completer = CompletionFormerCompleter(weights)
    with pytest.raises(InputError, match="31x40"):
        completer.complete(image[:, :31], depth[:, :31], valid[:, :31])
    with pytest.raises(NoMeasurementsError, match="completionformer"):
        completer.complete(image, depth, torch.zeros_like(valid))
    with pytest.raises(SizeMismatchError, match=r"\[40, 32\] but the image \[40, 31\]"):
        completer.complete(image[:, :31], depth, valid)
    with pytest.raises(CheckpointError, match="does not exist"):
        CompletionFormerCompleter(weights.with_name("other.pt"))
