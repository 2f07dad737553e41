"""Dense metric depth from one image plus whatever depth a sensor managed to measure.

    from steered_marigold import SteeredCompleter

    completer = SteeredCompleter.from_checkpoint("embedded")
    completion = completer.complete(image, sparse_depth)  # NumPy, PyTorch or PIL
    completion.depth          # [1, height, width], metres
    completion.uncertainty    # [1, height, width], metres

The same on the command line: `steered-marigold complete`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from steered_marigold.core.completion import DepthCompletion
    from steered_marigold.core.consistency import SensorNoise
    from steered_marigold.core.frame import Frame, make_frame
    from steered_marigold.diffusion.checkpoints import load_pipeline
    from steered_marigold.diffusion.pipeline import SteeredMarigoldPipeline
    from steered_marigold.errors import SteeredMarigoldError
    from steered_marigold.frames.complete import complete_frame
    from steered_marigold.frames.outputs import Outputs, save
    from steered_marigold.methods.completer import DepthCompleter
    from steered_marigold.methods.registry import create_method
    from steered_marigold.methods.steered import SteeredCompleter
    from steered_marigold.methods.streaming import StreamingCompleter

__all__ = [
    "DepthCompleter",
    "DepthCompletion",
    "Frame",
    "Outputs",
    "SensorNoise",
    "SteeredCompleter",
    "SteeredMarigoldError",
    "SteeredMarigoldPipeline",
    "StreamingCompleter",
    "complete_frame",
    "create_method",
    "load_pipeline",
    "make_frame",
    "save",
]

# imported when first used: `steered-marigold --help` needs no torch
_HOMES = {
    "DepthCompleter": "methods.completer",
    "DepthCompletion": "core.completion",
    "Frame": "core.frame",
    "Outputs": "frames.outputs",
    "SensorNoise": "core.consistency",
    "SteeredCompleter": "methods.steered",
    "SteeredMarigoldError": "errors",
    "SteeredMarigoldPipeline": "diffusion.pipeline",
    "StreamingCompleter": "methods.streaming",
    "complete_frame": "frames.complete",
    "create_method": "methods.registry",
    "load_pipeline": "diffusion.checkpoints",
    "make_frame": "core.frame",
    "save": "frames.outputs",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
