"""Without rosbags the package says what to install."""

import subprocess
import sys

_WITHOUT_ROSBAGS = """
import sys
sys.modules["rosbags"] = None
from steered_marigold.errors import MissingExtraError
try:
    import steered_marigold.io.bags
except MissingExtraError as error:
    print(error)
"""


def test_a_missing_rosbags_is_named_with_its_extra() -> None:
    command = [sys.executable, "-c", _WITHOUT_ROSBAGS]
    run = subprocess.run(command, check=True, capture_output=True, text=True)
    assert "rosbags is not installed" in run.stdout
    assert "steered-marigold[ros]" in run.stdout
