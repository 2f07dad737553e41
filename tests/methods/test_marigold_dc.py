import copy
from collections.abc import Callable
from itertools import pairwise
from typing import Any, cast

import pytest
import torch
from diffusers import AutoencoderKL, DDIMScheduler, UNet2DConditionModel
from jaxtyping import Bool, Float
from torch import Tensor
from transformers import CLIPTextConfig, CLIPTextModel, CLIPTokenizer

from steered_marigold.diffusion.pipeline import SteeredMarigoldPipeline
from steered_marigold.errors import InputError, NoMeasurementsError
from steered_marigold.methods.completer import DepthCompleter
from steered_marigold.methods.marigold_dc import MarigoldDCCompleter, guided_denoising

HEIGHT, WIDTH = 32, 48
Function = Callable[..., Tensor]


@pytest.fixture(scope="module")
def pipeline() -> Any:
    """The pipeline around models of the real classes, tiny and random."""
    torch.manual_seed(0)
    unet = UNet2DConditionModel(
        in_channels=8,
        out_channels=4,
        block_out_channels=(8, 16),
        layers_per_block=1,
        norm_num_groups=4,
        cross_attention_dim=8,
        attention_head_dim=4,
        down_block_types=("CrossAttnDownBlock2D", "DownBlock2D"),
        up_block_types=("UpBlock2D", "CrossAttnUpBlock2D"),
    )
    vae = AutoencoderKL(
        block_out_channels=(8, 8, 8, 8),
        down_block_types=("DownEncoderBlock2D",) * 4,
        up_block_types=("UpDecoderBlock2D",) * 4,
        norm_num_groups=4,
        latent_channels=4,
    )
    text_encoder = CLIPTextModel(
        CLIPTextConfig(
            vocab_size=2,
            hidden_size=8,
            intermediate_size=8,
            num_hidden_layers=1,
            num_attention_heads=2,
            bos_token_id=0,
            eos_token_id=1,
        )
    )
    vocabulary = {"<|startoftext|>": 0, "<|endoftext|>": 1}
    tokenizer = CLIPTokenizer(vocab=vocabulary, merges=[], model_max_length=77)
    pipe: Any = SteeredMarigoldPipeline(
        unet=unet,
        vae=vae,
        scheduler=schedule(1),
        text_encoder=text_encoder,
        tokenizer=tokenizer,
        prediction_type="depth",
        default_processing_resolution=48,
    )
    pipe.set_progress_bar_config(disable=True)
    return pipe


@pytest.fixture(scope="module")
def models(pipeline: Any) -> tuple[Function, Function]:
    """The pipeline's U-Net, with a random image and prompt, and its decoder, as functions."""
    image_latents, text = torch.randn(1, 4, HEIGHT // 8, WIDTH // 8), torch.randn(1, 2, 8)

    def predict(latents: Tensor, t: Tensor) -> Tensor:
        conditioned = torch.cat([image_latents, latents], 1)
        return cast(Tensor, pipeline.unet(conditioned, t, text).sample)

    def decode(latents: Tensor) -> Tensor:
        pixels: Tensor = pipeline.vae.decode(latents / 0.18215).sample
        return (pixels.mean(1)[0].clip(-1, 1) + 1) / 2

    return predict, decode


def schedule(steps: int) -> Any:
    scheduler: Any = DDIMScheduler(
        beta_start=0.00085,
        beta_end=0.012,
        beta_schedule="scaled_linear",
        prediction_type="v_prediction",
        clip_sample=False,
        timestep_spacing="trailing",
    )
    scheduler.set_timesteps(steps)
    return scheduler


def frame() -> tuple[Tensor, Float[Tensor, "32 48"], Bool[Tensor, "32 48"]]:
    generator = torch.Generator().manual_seed(1)
    latents = torch.randn(1, 4, HEIGHT // 8, WIDTH // 8, generator=generator)
    columns = torch.linspace(1, 4, WIDTH).expand(HEIGHT, -1)
    mask = torch.rand(HEIGHT, WIDTH, generator=generator) < 0.1
    return latents, columns.contiguous(), mask


class HandAdam:
    """Kingma and Ba, ICLR 2015, Algorithm 1."""

    def __init__(self, rate: float) -> None:
        self.rate, self.k = rate, 0
        self.m: Tensor | float = 0.0
        self.v: Tensor | float = 0.0

    def update(self, gradient: Tensor) -> Tensor:
        self.k += 1
        self.m = 0.9 * self.m + 0.1 * gradient
        self.v = 0.999 * self.v + 0.001 * gradient**2
        m, v = self.m / (1 - 0.9**self.k), self.v / (1 - 0.999**self.k)
        return -self.rate * m / (torch.as_tensor(v).sqrt() + 1e-8)


def test_equals_a_plain_transcription_of_the_algorithm(models: tuple[Function, Function]) -> None:
    predict, decode = models
    x, depth, mask = frame()
    low, high = depth[mask].min(), depth[mask].max()
    scheduler = schedule(4)
    actual = guided_denoising(predict, decode, scheduler, x, depth, mask)

    s, t = torch.ones(()), torch.ones(())
    adam_x, adam_s, adam_t = HandAdam(0.05), HandAdam(0.005), HandAdam(0.005)
    times = [999, 749, 499, 249, 0]
    for now, later in pairwise(times):
        abar = scheduler.alphas_cumprod[now]
        next_abar = scheduler.alphas_cumprod[later] if later else torch.ones(())
        for variable in (x, s, t):
            variable.requires_grad_()
        v = predict(x, torch.tensor(now))
        metric = (
            s * s * (high - low) * decode(abar.sqrt() * x - (1 - abar).sqrt() * v) + t * t * low
        )
        error = (metric - depth)[mask]
        gradients = torch.autograd.grad(error.abs().mean() + (error**2).mean(), (x, s, t))
        v, x, s, t = (variable.detach() for variable in (v, x, s, t))
        epsilon = abar.sqrt() * v + (1 - abar).sqrt() * x
        x = x + adam_x.update(gradients[0] * epsilon.norm() / gradients[0].norm())
        s, t = s + adam_s.update(gradients[1]), t + adam_t.update(gradients[2])
        x0 = abar.sqrt() * x - (1 - abar).sqrt() * v
        epsilon = abar.sqrt() * v + (1 - abar).sqrt() * x
        x = next_abar.sqrt() * x0 + (1 - next_abar).sqrt() * epsilon
    expected = s * s * (high - low) * decode(x) + t * t * low
    torch.testing.assert_close(actual, expected.detach(), atol=1e-4, rtol=1e-4)


def test_the_error_at_the_measurements_falls(models: tuple[Function, Function]) -> None:
    predict, decode = models
    latents, depth, mask = frame()
    near, far = depth[mask].min(), depth[mask].max()
    affine = []

    def recording_decode(x: Tensor) -> Tensor:
        affine.append(decode(x))
        return affine[-1]

    answer = guided_denoising(predict, recording_decode, schedule(50), latents, depth, mask)
    first = (far - near) * affine[0].detach() + near

    def error(estimate: Tensor) -> float:
        return (estimate - depth)[mask].abs().mean().item()

    assert error(answer) < 0.7 * error(first)
    # less than that of any constant: not only scale and shift have moved
    assert error(answer) < 0.7 * error(depth[mask].median())


def seeded() -> torch.Generator:
    return torch.Generator().manual_seed(3)


@pytest.mark.parametrize("processing_resolution", [None, 0, 24])
def test_completes_any_size_and_repeats_itself(
    pipeline: Any, processing_resolution: int | None
) -> None:
    method = MarigoldDCCompleter(
        pipeline, num_inference_steps=3, processing_resolution=processing_resolution
    )
    assert isinstance(method, DepthCompleter)
    image = torch.randint(0, 256, (37, 51, 3), dtype=torch.uint8, generator=seeded())
    depth = 1 + 4 * torch.rand(37, 51, generator=seeded())
    mask = depth > 4
    unmeasured = torch.where(mask, depth, torch.nan)
    answer = method.complete(image, unmeasured, mask, generator=seeded())
    again = method.complete(image, unmeasured, mask, generator=seeded())
    other = method.complete(image, unmeasured, mask, generator=torch.Generator().manual_seed(4))
    assert answer.depth.shape == (1, 37, 51)
    assert answer.depth.isfinite().all()
    assert torch.equal(answer.measured[0], mask)
    assert torch.equal(answer.depth, again.depth)
    assert not torch.equal(answer.depth, other.depth)


def test_an_ensemble_is_the_median_of_single_runs(pipeline: Any) -> None:
    _, depth, mask = frame()
    image = torch.zeros(HEIGHT, WIDTH, 3, dtype=torch.uint8)

    def run(members: int, generator: torch.Generator) -> Tensor:
        method = MarigoldDCCompleter(pipeline, num_inference_steps=2, ensemble_size=members)
        return method.complete(image, depth, mask, generator=generator).depth

    one_after_the_other = seeded()
    singles = torch.cat([run(1, one_after_the_other) for _ in range(3)])
    torch.testing.assert_close(run(3, seeded())[0], singles.median(0).values)


def test_one_measurement_gives_its_value_everywhere(pipeline: Any) -> None:
    method = MarigoldDCCompleter(pipeline, num_inference_steps=2)
    mask = torch.zeros(HEIGHT, WIDTH, dtype=torch.bool)
    mask[3, 5] = True
    image = torch.zeros(HEIGHT, WIDTH, 3, dtype=torch.uint8)
    answer = method.complete(image, torch.full((HEIGHT, WIDTH), 2.0), mask, generator=seeded())
    torch.testing.assert_close(answer.depth, torch.full((1, HEIGHT, WIDTH), 2.0))


def test_runs_in_bfloat16(pipeline: Any) -> None:
    _, depth, mask = frame()
    image = torch.zeros(HEIGHT, WIDTH, 3, dtype=torch.uint8)
    exact, rounded = (
        MarigoldDCCompleter(copy.deepcopy(pipeline).to(dtype=dtype), num_inference_steps=2)
        .complete(image, depth, mask, generator=seeded())
        .depth
        for dtype in (torch.float32, torch.bfloat16)
    )
    assert rounded.dtype == torch.float32
    assert 0 < (rounded - exact).abs().max() < 0.5


def test_bad_input(pipeline: Any) -> None:
    with pytest.raises(InputError, match="ensemble_size"):
        MarigoldDCCompleter(pipeline, ensemble_size=0)
    with pytest.raises(NoMeasurementsError, match="marigold-dc"):
        MarigoldDCCompleter(pipeline).complete(
            torch.zeros(8, 8, 3, dtype=torch.uint8),
            torch.ones(8, 8),
            torch.zeros(8, 8, dtype=torch.bool),
        )
    half = copy.deepcopy(pipeline).to(dtype=torch.float16)
    with pytest.raises(InputError, match="bfloat16"):
        MarigoldDCCompleter(half)
