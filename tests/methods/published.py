"""The names and shapes of the published weights, as checksums."""

import hashlib
from collections.abc import Iterable
from pathlib import Path

from torch import nn

LISTS = Path(__file__).resolve().parents[3] / "shared" / "baselines"


def names_and_shapes(network: nn.Module) -> str:
    """SHA-256 of the sorted lines "name shape" of a state dict."""
    state = network.state_dict()
    return checksum(f"{name} {tuple(value.shape)}" for name, value in state.items())


def checksum(lines: Iterable[str]) -> str:
    """SHA-256 of the sorted lines."""
    return hashlib.sha256("\n".join(sorted(lines)).encode()).hexdigest()


def published_list(method: str) -> list[str]:
    """The published lines "name shape"; none where the list is not on this machine."""
    path = LISTS / f"{method}_state_dict.txt"
    return path.read_text().splitlines() if path.is_file() else []
