"""What the commands say on stderr, a line each; stdout is for results."""

import sys
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from steered_marigold.core.notices import name_arguments

if TYPE_CHECKING:
    from steered_marigold.frames.complete import Record

# options that have another name than the argument of the library
_OPTIONS = {
    "num_inference_steps": "steps",
    "ensemble_size": "ensemble",
    "processing_resolution": "resolution",
    "K": "intrinsics",
    "sparse_depth": "depth",
}
_FLAGS: dict[str, str] = {}


def say(message: object) -> None:
    """How a run went."""
    print(_in_words_of_the_command(" ".join(str(message).splitlines())), file=sys.stderr)


def say_error(error: object) -> None:
    """What could not be done."""
    say(f"error: {error}")


def say_warning(warning: object) -> None:
    """What was done, but may not be what was meant."""
    say(f"warning: {warning}")


def warn_of(frame: object, record: "Record") -> None:
    """What a person should know of a frame."""
    for notice in record.notices:
        say_warning(f"{frame}: {notice.text}")


def _in_words_of_the_command(text: str) -> str:
    """`max_depth`, an argument of the library in backticks, becomes --max-depth, and so on."""

    def named(name: str, value: str) -> str | None:
        flag = _FLAGS.get(_OPTIONS.get(name, name))
        return None if flag is None else " ".join(filter(None, (flag, value)))

    return name_arguments(text, named)


def name_parameters(parameters: Iterable[Any]) -> None:
    """From now on, say of the command's parameters what its user calls them."""
    _FLAGS.clear()
    for parameter in parameters:
        longest = max(parameter.opts, key=len)
        _FLAGS[parameter.name] = longest if longest.startswith("-") else longest.upper()
