"""What a reader of results should be told: the record, without where or how it is shown."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Notice:
    """Something was read otherwise than written, or is doubtful.

    kind: one word for programs, the same for the same matter in every frame.
    text: one complete sentence for people, with arguments in backticks.
    """

    kind: str
    text: str


Notices = tuple[Notice, ...]
