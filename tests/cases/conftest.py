"""The folders of small inputs that people met; the tests re-create what they show as well."""

from collections.abc import Callable
from pathlib import Path

import pytest

CASES = Path(__file__).resolve().parents[3] / "shared" / "cases"


@pytest.fixture(scope="session")
def case() -> Callable[[str], Path]:
    """The folder of a case, by name; skips where the shared files are absent."""

    def folder(name: str) -> Path:
        if not (CASES / name).is_dir():
            pytest.skip(f"{CASES / name} is not on this machine")
        return CASES / name

    return folder
