"""What the package brings along, and what it does not do on import."""

import re
import subprocess
import sys
from importlib.metadata import PackageNotFoundError, distribution, requires
from typing import Any

from packaging.requirements import Requirement

_NO_SOCKETS = """
import socket, sys
def refuse(*args, **kwargs):
    raise RuntimeError("a socket was opened")
socket.socket.connect = socket.create_connection = socket.getaddrinfo = refuse
import steered_marigold
for name in steered_marigold.__all__:
    getattr(steered_marigold, name)
import steered_marigold.cli
"""
# of the required dependencies and theirs, as their metadata says; none forbids any use
_FREE = re.compile(
    r"apache|bsd|mit\b|isc|python|psf|mpl|mozilla|zlib|hpnd|unlicense|cc0|public domain|0bsd", re.I
)


def test_import_opens_no_connection() -> None:
    subprocess.run([sys.executable, "-c", _NO_SOCKETS], check=True)


def _needed(name: str, found: set[str]) -> None:
    """Adds a distribution and what it needs, without extras."""
    key = name.lower().replace("_", "-")
    if key in found:
        return
    found.add(key)
    for text in requires(name) or ():
        needed = Requirement(text)
        if needed.marker is None or needed.marker.evaluate({"extra": ""}):
            try:
                _needed(needed.name, found)
            except PackageNotFoundError:
                found.discard(needed.name.lower())


def test_every_required_package_has_a_free_licence() -> None:
    found: set[str] = set()
    _needed("steered-marigold", found)
    assert {"torch", "numpy", "diffusers"} <= found
    unknown = {}
    for name in sorted(found):
        told: Any = distribution(name).metadata
        kinds = [x for x in told.get_all("Classifier") or () if x.startswith("License ::")]
        kinds += told.get_all("License-Expression") or ()
        kinds += [text[:300] for text in told.get_all("License") or ()]
        # where nothing says it, the readme may
        if not _FREE.search(" ".join([*kinds, told.json["description"] if not kinds else ""])):
            unknown[name] = kinds
    # NVIDIA's libraries come with torch on CUDA machines alone, under terms of their own
    assert {name for name in unknown if not name.startswith(("nvidia", "cuda"))} == set(), unknown
