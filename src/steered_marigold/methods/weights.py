"""State dicts that authors published: read safely, compared strictly."""

from argparse import Namespace
from collections.abc import Mapping
from pathlib import Path

import torch
from safetensors.torch import load_file
from torch import Tensor, nn

from steered_marigold.errors import CheckpointError

WRAPPERS = ("net", "model")


def load_published(module: nn.Module, path: Path) -> None:
    """Gives `module`, which may be on the meta device, the tensors of the file.

    path: .safetensors, or anything else for a file of torch.save: a state dict, bare or under
    "net" or "model", its names with or without DistributedDataParallel's "module.".

    Raises CheckpointError if the file is missing, cannot be read without running code from it, or
    has other names or shapes than `module`.
    """
    state = _state_dict(path)
    _compare(state, module, path)
    module.load_state_dict(state, assign=True)


def _state_dict(path: Path) -> dict[str, Tensor]:
    if not path.is_file():
        raise CheckpointError(f"{path} does not exist; docs/baselines.md says where to get weights")
    content = _read(path)
    if isinstance(content, Mapping):
        content = next((content[name] for name in WRAPPERS if name in content), content)
    if not isinstance(content, Mapping) or not all(
        isinstance(name, str) and isinstance(value, Tensor) for name, value in content.items()
    ):
        raise CheckpointError(f"{path} holds no state dict, neither bare nor under {WRAPPERS}")
    return {name.removeprefix("module."): value for name, value in content.items()}


def _read(path: Path) -> object:
    try:
        if path.suffix == ".safetensors":
            return load_file(path)
        # training programs store their arguments beside the weights: a Namespace only holds data
        with torch.serialization.safe_globals([Namespace]):
            return torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # a damaged file can fail anywhere in its reader
        raise CheckpointError(
            f"{path} cannot be read as weights alone ({type(error).__name__}); it is damaged, or "
            "needs code to be run: get the authors' file again"
        ) from error


def _compare(state: Mapping[str, Tensor], module: nn.Module, path: Path) -> None:
    expected = {name: tuple(value.shape) for name, value in module.state_dict().items()}
    found = {name: tuple(value.shape) for name, value in state.items()}
    differences = {
        "missing": [f"{name} {expected[name]}" for name in expected if name not in found],
        "unexpected": [f"{name} {found[name]}" for name in found if name not in expected],
        "of another shape": [
            f"{name} {found[name]} instead of {expected[name]}"
            for name in expected
            if name in found and found[name] != expected[name]
        ],
    }
    parts = [
        f"{len(names)} {kind}, first {names[0]}" for kind, names in differences.items() if names
    ]
    if parts:
        raise CheckpointError(f"{path} does not fit {type(module).__name__}: {'; '.join(parts)}")
