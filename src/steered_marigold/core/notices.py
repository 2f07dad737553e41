"""What was read or done otherwise than asked, for whoever has to say it."""

import re
from collections.abc import Callable
from dataclasses import dataclass

_ARGUMENT = re.compile(r"`(?P<name>\w+)(?:=(?P<value>[^`]*))?`")


@dataclass(frozen=True)
class Notice:
    """One thing that a caller should know.

    kind: a word to tell it by, e.g. "implausible_scale". text: one sentence; arguments of this
    package stand in backticks, so that a front end can name its own instead.
    """

    kind: str
    text: str


Notices = tuple[Notice, ...]


def name_arguments(text: str, named: Callable[[str, str], str | None]) -> str:
    """A message with the names that a front end has for the arguments in backticks.

    named: gets the argument's name and, of `name=value`, the value, else ""; with None for an
    answer the argument stays as it is, without backticks.
    """

    def in_words(match: re.Match[str]) -> str:
        words = named(match["name"], match["value"] or "")
        return match[0].strip("`") if words is None else words

    return _ARGUMENT.sub(in_words, text)
