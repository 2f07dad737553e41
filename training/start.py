"""Where a stage begins that has no run yet: the weights of a checkpoint."""

from pathlib import Path

import torch
from safetensors.torch import load_file
from torch import nn

CHECKPOINT = Path(__file__).parents[1] / "src" / "steered_marigold" / "assets" / "checkpoint"


def has_run(run: Path) -> bool:
    """Whether a stage's folder holds weights to go on with."""
    return (run / "last.pt").exists()


def load_part(model: nn.Module, checkpoint: Path | None, part: str) -> None:
    """Fills a model with a checkpoint's part: "image_encoder", "vae" or "unet".

    checkpoint: a folder in Marigold's layout; None leaves the model as it is.
    Raises ValueError if the recipe has since given that part another shape.
    """
    if checkpoint is None:
        return
    try:
        model.load_state_dict(load_file(checkpoint / part / "diffusion_pytorch_model.safetensors"))
    except RuntimeError as error:
        raise ValueError(
            f"{checkpoint / part} does not fit the recipe; begin with --from scratch"
        ) from error


@torch.no_grad()
def blend(model: nn.Module, checkpoint: Path | None, part: str, share: float) -> None:
    """Weights between those of a checkpoint's part and the model's, of which this share is kept.

    A model that was trained on from those weights keeps some of what it forgot (Wortsman et al.,
    "Robust fine-tuning of zero-shot models", CVPR 2022). Raises ValueError without a checkpoint.
    """
    if checkpoint is None:
        raise ValueError("a share below 1 needs the checkpoint that the weights began with")
    before = load_file(checkpoint / part / "diffusion_pytorch_model.safetensors")
    for name, value in model.state_dict().items():
        value.lerp_(before[name].to(value), 1 - share)
