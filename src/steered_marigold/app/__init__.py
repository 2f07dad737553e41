"""The page in the browser: `steered-marigold app`.

Importing this package without gradio and trimesh raises MissingExtraError.
"""

import os

from steered_marigold.errors import MissingExtraError

# read when gradio is imported: nothing is told to anybody
os.environ["GRADIO_ANALYTICS_ENABLED"] = "False"
os.environ["HF_HUB_DISABLE_TELEMETRY"] = "1"

try:
    import gradio  # noqa: F401
except ImportError as error:
    raise MissingExtraError("app", "gradio") from error
try:
    import trimesh  # noqa: F401
except ImportError as error:
    raise MissingExtraError("app", "trimesh") from error
