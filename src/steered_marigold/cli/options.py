"""What the commands' options share."""

from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import Any

from typer import BadParameter, Option

from steered_marigold.errors import InputError
from steered_marigold.io.remote import location


class Dtype(StrEnum):
    """What the model computes in; auto: what the device has matrix instructions for."""

    AUTO = "auto"
    FLOAT32 = "float32"
    BFLOAT16 = "bfloat16"
    FLOAT16 = "float16"


def path_or_url(text: str) -> Path:
    """What a user types for either."""
    try:
        return location(text)
    except InputError as error:
        raise BadParameter(str(error)) from error


def option_panel(title: str) -> Callable[..., Any]:
    """`Option` under a heading of the help. Brackets in help texts are shown as they are."""

    def option(*names: str, help: str, **kwargs: Any) -> Any:
        text = help.replace("[", r"\[")  # else taken for markup
        return Option(*names, help=text, rich_help_panel=title, **kwargs)

    return option
