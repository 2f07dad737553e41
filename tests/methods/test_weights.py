from argparse import Namespace
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file
from torch import Tensor, nn

from steered_marigold.errors import CheckpointError
from steered_marigold.methods.weights import load_published

State = dict[str, Tensor]


def network() -> nn.Module:
    return nn.Sequential(nn.Linear(2, 3), nn.BatchNorm1d(3))


def bare(state: State, path: Path) -> None:
    torch.save(state, path)


def beside_arguments(state: State, path: Path) -> None:
    torch.save({"net": state, "args": Namespace(lr=0.001, betas=(0.9, 0.999)), "epoch": 3}, path)


def distributed(state: State, path: Path) -> None:
    torch.save({"model": {f"module.{name}": value for name, value in state.items()}}, path)


@pytest.mark.parametrize(
    ("save", "suffix"),
    [(bare, "pth"), (beside_arguments, "pt"), (distributed, "pth"), (save_file, "safetensors")],
)
@pytest.mark.parametrize("device", ["cpu", "meta"])
def test_what_was_saved_is_loaded(
    save: Callable[[State, Path], None], suffix: str, device: str, tmp_path: Path
) -> None:
    state = {name: torch.rand(()) + value for name, value in network().state_dict().items()}
    save(state, tmp_path / f"weights.{suffix}")
    with torch.device(device):
        module = network()
    load_published(module, tmp_path / f"weights.{suffix}")
    torch.testing.assert_close(dict(module.state_dict()), state, rtol=0, atol=0)


def test_differences_are_named_with_shapes(tmp_path: Path) -> None:
    state = network().state_dict()
    del state["0.bias"]
    state["head.weight"] = torch.zeros(1, 4)
    state["1.weight"] = torch.zeros(5)
    torch.save(state, tmp_path / "other.pth")
    with pytest.raises(CheckpointError) as caught:
        load_published(network(), tmp_path / "other.pth")
    message = str(caught.value)
    assert str(tmp_path / "other.pth") in message
    assert "1 missing, first 0.bias (3,)" in message
    assert "1 unexpected, first head.weight (1, 4)" in message
    assert "1 of another shape, first 1.weight (5,) instead of (3,)" in message


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match=r"nowhere\.pth does not exist"):
        load_published(network(), tmp_path / "nowhere.pth")


@pytest.mark.parametrize("suffix", ["pth", "safetensors"])
def test_a_damaged_file_is_named(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"cut.{suffix}"
    (save_file if suffix == "safetensors" else bare)(network().state_dict(), path)
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(CheckpointError, match=f"cut.{suffix} cannot be read"):
        load_published(network(), path)


class Intruder:
    def __init__(self, target: Path) -> None:
        self.target = target

    def __reduce__(self) -> tuple[Callable[[Path], None], tuple[Path]]:
        return Path.touch, (self.target,)


def test_code_in_a_file_is_not_run(tmp_path: Path) -> None:
    torch.save({"net": Intruder(tmp_path / "ran")}, tmp_path / "evil.pth")
    with pytest.raises(CheckpointError, match=r"evil\.pth cannot be read"):
        load_published(network(), tmp_path / "evil.pth")
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize("content", [[1, 2], {"net": 3}, {"epoch": 3}, {0: torch.zeros(1)}])
def test_other_content_is_no_state_dict(content: object, tmp_path: Path) -> None:
    torch.save(content, tmp_path / "log.pth")
    with pytest.raises(CheckpointError, match="holds no state dict"):
        load_published(network(), tmp_path / "log.pth")
