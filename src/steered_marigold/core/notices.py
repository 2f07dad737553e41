"""What was read or done otherwise than asked, for whoever has to say it."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Notice:
    """One thing that a caller should know.

    kind: a word to tell it by, e.g. "implausible_scale". text: one sentence; arguments of this
    package stand in backticks, so that a front end can name its own instead.
    """

    kind: str
    text: str


Notices = tuple[Notice, ...]
