"""What the commands say on stderr, a line each; stdout is for results."""

import sys


def say(message: object) -> None:
    """How a run went."""
    print(" ".join(str(message).splitlines()), file=sys.stderr)


def say_error(error: object) -> None:
    """What could not be done."""
    say(f"error: {error}")


def say_warning(warning: object) -> None:
    """What was done, but may not be what was meant."""
    say(f"warning: {warning}")
