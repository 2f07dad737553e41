"""The public API is what this file says."""

import steered_marigold

PUBLIC = [
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


def test_public_names() -> None:
    assert steered_marigold.__all__ == PUBLIC
    assert all(getattr(steered_marigold, name) is not None for name in PUBLIC)
