"""The public API is what this file says."""

import steered_marigold

PUBLIC = [
    "DepthCompleter",
    "DepthCompletion",
    "SensorNoise",
    "SteeredCompleter",
    "SteeredMarigoldError",
    "SteeredMarigoldPipeline",
    "StreamingCompleter",
    "create_method",
    "load_pipeline",
]


def test_public_names() -> None:
    assert steered_marigold.__all__ == PUBLIC
    assert all(getattr(steered_marigold, name) is not None for name in PUBLIC)
