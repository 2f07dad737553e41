"""Methods by name, as tables and the command line call them.

A name may carry settings after `@`: `steered:paper@steering_strength=0.2`, or
`marigold@ensemble_size=8,num_inference_steps=10`. They are the keyword arguments of the class.
"""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from importlib import import_module
from inspect import Parameter, formatannotation, signature
from pathlib import Path
from types import UnionType
from typing import Any, Literal, Union, cast, get_args, get_origin

import torch

from steered_marigold.errors import CheckpointError, InputError
from steered_marigold.methods.protocol import DepthCompleter


@dataclass(frozen=True)
class _Source:
    """Where a method lives; imported only when asked for. `fixed`: arguments its name implies."""

    module: str
    cls: str
    fixed: Mapping[str, str] = field(default_factory=dict)


_SOURCES = {
    "nearest": _Source("interpolation", "NearestCompleter"),
    "linear": _Source("interpolation", "LinearCompleter"),
    "ip-basic": _Source("ip_basic", "IpBasicCompleter"),
    "telea": _Source("inpainting", "OpenCvInpainter", {"algorithm": "telea"}),
    "navier-stokes": _Source("inpainting", "OpenCvInpainter", {"algorithm": "navier-stokes"}),
    "colorization": _Source("inpainting", "ColorizationCompleter"),
    "marigold": _Source("steered", "MarigoldCompleter"),
    "steered": _Source("steered", "SteeredCompleter", {"preset": "default"}),
    "steered:paper": _Source("steered", "SteeredCompleter", {"preset": "paper"}),
    "steered:default": _Source("steered", "SteeredCompleter", {"preset": "default"}),
    "steered:fast": _Source("steered", "SteeredCompleter", {"preset": "fast"}),
    "marigold-dc": _Source("marigold_dc", "MarigoldDCCompleter"),
    "bpnet": _Source("bpnet", "BPNetCompleter"),
    "completionformer": _Source("completionformer", "CompletionFormerCompleter"),
}
METHODS = tuple(_SOURCES)


def create_method(
    name: str,
    *,
    checkpoint: str = "embedded",
    device: str = "cpu",
    dtype: torch.dtype | None = None,
    weights: Mapping[str, Path] | None = None,
) -> DepthCompleter:
    """The method called `name`, one of METHODS, with settings after `@` if wanted.

    checkpoint: for the methods that run a Marigold-format checkpoint. device, dtype: for those
    that have a network; None is the method's own precision. weights: the authors' files of
    "bpnet" and "completionformer", by method.

    Raises InputError for an unknown method or setting, CheckpointError for weights that lack.
    """
    base, _, text = name.partition("@")
    if base not in _SOURCES:
        raise InputError(f"no method is called {base!r}; there are: {', '.join(METHODS)}")
    source = _SOURCES[base]
    cls = getattr(import_module(f"steered_marigold.methods.{source.module}"), source.cls)
    build = getattr(cls, "from_checkpoint", cls)
    parameters = signature(build, eval_str=True).parameters
    weights_file = (weights or {}).get(base)
    if "weights" in parameters and weights_file is None:
        raise CheckpointError(
            f"{base} needs its authors' weights file: weights[{base!r}], or --weights on the "
            "command line; docs/baselines.md says where to get it"
        )
    offered = {
        "checkpoint": checkpoint,
        "device": device,
        "dtype": dtype,
        "weights": weights_file,
        **source.fixed,
    }
    arguments = {key: value for key, value in offered.items() if key in parameters}
    kinds = {
        key: _readable_kinds(parameter.annotation)
        for key, parameter in parameters.items()
        if key not in arguments and parameter.kind is Parameter.KEYWORD_ONLY
    }
    return cast(DepthCompleter, build(**arguments, **_parse_settings(base, text, kinds)))


def _readable_kinds(hint: Any) -> list[Any]:
    """The types in an annotation that text can be read as: none for a flag or a record."""
    kinds = get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)
    return [k for k in kinds if k in (bool, int, float, str) or get_origin(k) is Literal]


def _parse_settings(method: str, text: str, kinds: Mapping[str, list[Any]]) -> dict[str, object]:
    """`key=value,key=value` as keyword arguments. kinds: the types of each setting, if any."""
    known = [key for key in kinds if kinds[key]]
    settings: dict[str, object] = {}
    for item in filter(None, text.split(",")):
        key, _, value = item.partition("=")
        if key not in known:
            raise InputError(
                f"{method} has no setting {key!r}; it has: {', '.join(known) or 'none'}"
            )
        try:
            settings[key] = _parse_value(value, kinds[key])
        except ValueError:
            expected = " or ".join(map(formatannotation, kinds[key]))
            raise InputError(f"{method}: {key}={value!r} is no {expected}") from None
    return settings


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
