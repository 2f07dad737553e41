"""Methods by name, as tables and the command line call them.

A name may carry settings after `@`: `paper@steering_strength=0.2`, or
`marigold@ensemble_size=8,num_inference_steps=10`. They are the keyword arguments of the class, and
the knobs of `diffusion.settings` for those that have them.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import import_module
from inspect import Parameter, signature
from pathlib import Path
from typing import cast

import torch

from steered_marigold.errors import CheckpointError, InputError
from steered_marigold.methods.completer import DepthCompleter
from steered_marigold.methods.settings_text import read_settings


@dataclass(frozen=True)
class _Source:
    """Where a method lives; imported only when asked for. `fixed`: arguments its name implies."""

    module: str
    cls: str
    fixed: Mapping[str, str | None] = field(default_factory=dict)


_SOURCES = {
    "nearest": _Source("interpolation", "NearestCompleter"),
    "linear": _Source("interpolation", "LinearCompleter"),
    "ip-basic": _Source("ip_basic", "IpBasicCompleter"),
    "telea": _Source("inpainting", "OpenCvInpainter", {"algorithm": "telea"}),
    "navier-stokes": _Source("inpainting", "OpenCvInpainter", {"algorithm": "navier-stokes"}),
    "colorization": _Source("inpainting", "ColorizationCompleter"),
    "realsense-left": _Source("hole_filling", "HoleFillingFilter", {"mode": "left"}),
    "realsense-farthest": _Source("hole_filling", "HoleFillingFilter", {"mode": "farthest"}),
    "realsense-nearest": _Source("hole_filling", "HoleFillingFilter", {"mode": "nearest"}),
    "realsense-spatial": _Source("hole_filling", "SpatialFilter"),
    "marigold": _Source("steered", "SteeredCompleter", {"preset": None}),
    "default": _Source("steered", "SteeredCompleter", {"preset": "default"}),
    "fast": _Source("steered", "SteeredCompleter", {"preset": "fast"}),
    "paper": _Source("steered", "SteeredCompleter", {"preset": "paper"}),
    "paper-minmax": _Source("steered", "SteeredCompleter", {"preset": "paper-minmax"}),
    "marigold-dc": _Source("marigold_dc", "MarigoldDCCompleter"),
    "bpnet": _Source("bpnet", "BPNetCompleter"),
    "completionformer": _Source("completionformer", "CompletionFormerCompleter"),
}
METHODS = tuple(_SOURCES)
# names of version 0.1.0, to go with 0.3.0
_FORMER = {
    "steered": "default",
    "steered:default": "default",
    "steered:fast": "fast",
    "steered:paper": "paper",
}


def method_label(name: str) -> str:
    """The name that tables use for a method: that of METHODS, with its settings after `@`.

    Raises InputError for an unknown method.
    """
    base, at, settings = name.partition("@")
    base = _FORMER.get(base, base)
    if base not in _SOURCES:
        raise InputError(f"no method is called {base!r}; there are: {', '.join(METHODS)}")
    return f"{base}{at}{settings}"


def steers(name: str) -> bool:
    """Whether a method moves a diffusion model's predictions, told without loading it.

    False for a name that is not of METHODS.
    """
    base, _, text = name.partition("@")
    source = _SOURCES.get(_FORMER.get(base, base))
    if source is None or "preset" not in source.fixed:
        return False
    from steered_marigold.diffusion.settings import KNOBS, get_preset  # brings SciPy along

    knobs = read_settings(base, filter(None, text.split(",")), KNOBS)
    return get_preset(source.fixed["preset"]).override(**knobs).steering.steering_strength != 0


def create_method(
    name: str,
    *,
    checkpoint: str = "embedded",
    device: str = "cpu",
    dtype: torch.dtype | str | None = None,
    weights: Mapping[str, Path] | None = None,
) -> DepthCompleter:
    """The method called `name`, one of METHODS, with settings after `@` if wanted.

    checkpoint: for the methods that run a Marigold-format checkpoint. device, dtype: for those
    that have a network; None is the method's own precision. weights: the authors' files of
    "bpnet" and "completionformer", by method.

    Raises InputError for an unknown method or setting, CheckpointError for weights that lack.
    """
    base, _, text = method_label(name).partition("@")
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
    hints = {
        key: parameter.annotation
        for key, parameter in parameters.items()
        if key not in arguments and parameter.kind is Parameter.KEYWORD_ONLY
    }
    hints |= getattr(cls, "settings", {})
    return cast(
        DepthCompleter,
        build(**arguments, **read_settings(base, filter(None, text.split(",")), hints)),
    )
