"""Arguments and fields in the reference as lists: an extension of Griffe, which reads docstrings.

Docstrings of this package name them in sentences, as "image: RGB. K: intrinsics [px]." On the site
each of them is an item of a list.
"""

import re
from collections.abc import Collection
from typing import Any

import griffe

_NAMED = re.compile(r"(?:^|(?<=\. ))(\w+(?:, \w+)*(?: and \w+)?): ")


class ArgumentLists(griffe.Extension):
    """Rewrites docstrings of functions and classes."""

    def on_function(self, *, func: Any, **_: Any) -> None:
        """Its parameters."""
        _rewrite(func, {parameter.name.lstrip("*") for parameter in func.parameters})

    def on_class(self, *, cls: Any, **_: Any) -> None:
        """Its fields, and the parameters of its constructor."""
        names = set(cls.members)
        if "__init__" in cls.members:
            names |= {parameter.name for parameter in cls.members["__init__"].parameters}
        _rewrite(cls, names)


def _rewrite(item: Any, names: Collection[str]) -> None:
    if item.docstring:
        item.docstring.value = listed(item.docstring.value, names)


def listed(text: str, names: Collection[str]) -> str:
    """The text with every paragraph's sentences about these names as items of a list."""
    return "\n\n".join(_paragraph(part, names) for part in text.split("\n\n"))


def _paragraph(text: str, names: Collection[str]) -> str:
    joined = " ".join(text.split())
    found = [
        match
        for match in _NAMED.finditer(joined)
        if all(name in names for name in re.split(r", | and ", match[1]))
    ]
    if not found:
        return text
    ends = [match.start() for match in found[1:]] + [len(joined)]
    items = [
        f"- **{match[1]}**: {joined[match.end() : end].strip()}"
        for match, end in zip(found, ends, strict=True)
    ]
    before = joined[: found[0].start()].strip()
    return "\n".join(([before, ""] if before else []) + items)
