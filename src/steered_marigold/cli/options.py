"""What the commands' options share."""

from collections.abc import Callable
from enum import StrEnum
from typing import Any

from typer import Option


class Dtype(StrEnum):
    """What the model computes in; auto: what the device has matrix instructions for."""

    AUTO = "auto"
    FLOAT32 = "float32"
    BFLOAT16 = "bfloat16"
    FLOAT16 = "float16"


def option_panel(title: str) -> Callable[..., Any]:
    """`Option` under a heading of the help. Brackets in help texts are shown as they are."""

    def option(*names: str, help: str, **kwargs: Any) -> Any:
        text = help.replace("[", r"\[")  # else taken for markup
        return Option(*names, help=text, rich_help_panel=title, **kwargs)

    return option
