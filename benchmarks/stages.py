"""The stages of an image, each as the reference does it and as the package does."""

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from benchmarks import reference
from benchmarks.measuring import Timing, measure_interleaved
from benchmarks.runs import REFERENCE
from benchmarks.subjects import BenchmarkFrame
from steered_marigold.core.anchors import far_from_known, select_anchors, thin_measurements
from steered_marigold.core.consistency import SensorNoise
from steered_marigold.core.finishing import finish
from steered_marigold.core.interpolation import ScatteredInterpolant
from steered_marigold.core.steering import normalise_condition, steering_target
from steered_marigold.diffusion.settings import get_preset

BFLOAT16 = "bfloat16, channels-last"
PRESET = "default"
# what a stage is, in each of its variants
Works = Mapping[str, Callable[[], object]]
Timings = dict[str, dict[str, Timing]]


@dataclass(frozen=True)
class Networks:
    """The networks of a checkpoint. image: its image encoder, None for the VAE.

    prompt: [1, tokens, channels]. In one precision and memory format.
    """

    unet: Any
    vae: Any
    image: Any
    prompt: Tensor

    def in_bfloat16(self) -> "Networks":
        """A copy in bfloat16, with channels last."""
        unet, vae, image = (
            m and copy.deepcopy(m).bfloat16().to(memory_format=torch.channels_last)
            for m in (self.unet, self.vae, self.image)
        )
        return Networks(unet, vae, image, self.prompt.to(torch.bfloat16))


def time_stages(
    networks: Networks, frame: BenchmarkFrame, *, warm_up: int, repeats: int
) -> Timings:
    """Timings of each stage and variant on the frame's own grid, one sample at a time."""
    height, width = frame.mask.shape
    both = {REFERENCE: networks, BFLOAT16: networks.in_bfloat16()}
    calls = {name: _network_calls(n, height, width) for name, n in both.items()}
    stages: dict[str, Works] = {
        stage: {name: calls[name][stage] for name in both} for stage in calls[REFERENCE]
    }
    stages |= _steering_stages(frame)
    stages["finish"] = _finish_stage(frame)
    with torch.no_grad():
        return {
            stage: measure_interleaved(works, warm_up=warm_up, repeats=repeats)
            for stage, works in stages.items()
        }


def _network_calls(networks: Networks, height: int, width: int) -> dict[str, Callable[[], object]]:
    """The networks on random input of a grid's size [px]."""
    unet, vae, dtype = networks.unet, networks.vae, networks.prompt.dtype
    channels = unet.config.in_channels
    generator = torch.Generator().manual_seed(0)
    pixels = torch.rand(1, 3, height, width, generator=generator).to(dtype) * 2 - 1
    latents = torch.randn(1, channels, height // 8, width // 8, generator=generator).to(dtype)
    t = torch.tensor(500)

    def encode_image() -> object:
        return vae.encode(pixels) if networks.image is None else networks.image(pixels)

    return {
        "image": encode_image,
        "unet": lambda: unet(latents, t, encoder_hidden_states=networks.prompt),
        "decode": lambda: vae.decode(latents[:, -4:]),
        "encode": lambda: vae.encode(pixels),
    }


def _steering_stages(frame: BenchmarkFrame) -> dict[str, Works]:
    """What steering needs once, and the target that it computes in each step.

    The reference prepares nothing: it draws and triangulates in every step.
    """
    depth, mask = frame.sparse_depth.double().numpy(), frame.mask.numpy()
    predicted = torch.rand(frame.mask.shape, generator=torch.Generator().manual_seed(0)) * 2 - 1
    map_, c = predicted.double().numpy(), reference.normalise(depth, mask)
    anchors, interpolant = _prepare(frame)
    condition = normalise_condition(frame.sparse_depth[None], frame.mask[None])

    def both_interpolations() -> object:
        points, known = reference.draw_positions(mask, torch.Generator().manual_seed(0))
        return reference.move(map_, c, points, known)

    ours = f"preset {PRESET}"
    return {
        "steer: prepare, once": {ours: lambda: _prepare(frame)},
        "steer: target, each step": {
            REFERENCE: both_interpolations,
            ours: lambda: steering_target(predicted[None], condition, anchors, interpolant),
        },
    }


def _prepare(frame: BenchmarkFrame) -> Any:
    """(anchors, interpolant) of a frame, as in the preset."""
    settings = get_preset(PRESET).steering
    assert settings.max_anchors is not None
    anchors = select_anchors(
        thin_measurements(frame.mask, settings.max_anchors),
        far_from_known(frame.mask, settings.neighborhood_px),
        anchor_fraction=settings.anchor_fraction,
        generator=torch.Generator().manual_seed(0),
    )
    height, width = frame.mask.shape
    return anchors, ScatteredInterpolant(anchors.points, (height, width))


def _finish_stage(frame: BenchmarkFrame) -> Works:
    """A prediction that is wrong by a smooth factor, to metric depth."""
    depth = frame.sparse_depth
    bend = torch.linspace(0.9, 1.1, depth.shape[1])
    affine = depth * bend / (depth * bend).max()
    map_, metres, mask = affine.double().numpy(), depth.double().numpy(), frame.mask.numpy()
    image = frame.unit_image

    def ours() -> object:
        settings = get_preset(PRESET).finish
        return finish(affine[None], depth, frame.mask, settings, noise=SensorNoise(), image=image)

    return {REFERENCE: lambda: reference.fit(map_, metres, mask), f"preset {PRESET}": ours}
