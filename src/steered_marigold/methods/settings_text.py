"""Settings as people type them: `key=value`, read by the types of what they set."""

from collections.abc import Iterable, Mapping
from contextlib import suppress
from inspect import formatannotation
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin

from steered_marigold.errors import InputError


def read_settings(owner: str, items: Iterable[str], hints: Mapping[str, Any]) -> dict[str, Any]:
    """`key=value` each, as keyword arguments. owner: whose they are. hints: a type for each key.

    Raises InputError for a key that the owner does not have, or a value that does not fit.
    """
    kinds = {key: _readable_kinds(hint) for key, hint in hints.items()}
    known = [key for key in kinds if kinds[key]]
    settings: dict[str, Any] = {}
    for item in items:
        key, _, value = item.partition("=")
        if key not in known:
            raise InputError(
                f"{owner} has no setting {key!r}; it has: {', '.join(known) or 'none'}"
            )
        try:
            settings[key] = _parse_value(value, kinds[key])
        except ValueError:
            expected = " or ".join(map(formatannotation, kinds[key]))
            raise InputError(f"{owner}: {key}={value!r} is no {expected}") from None
    return settings


def _readable_kinds(hint: Any) -> list[Any]:
    """The types in an annotation that text can be read as: none for a flag or a record."""
    kinds = get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)
    return [k for k in kinds if k in (bool, int, float, str) or get_origin(k) is Literal]


def _parse_value(text: str, kinds: list[Any]) -> object:
    """`text` as the first of the types that it fits; ValueError if it fits none."""
    for kind in kinds:
        if get_origin(kind) is Literal:
            if text in get_args(kind):
                return text
        elif kind is bool:
            if text in ("true", "false"):
                return text == "true"
        else:
            with suppress(ValueError):
                return kind(text)
    raise ValueError(text)
