"""Checkpoints like the embedded one, without diffusers: the same answers, sooner."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from diffusers import AutoencoderKL, DDIMScheduler, UNet2DConditionModel
from safetensors.torch import load_file, save_file
from torch import Tensor

from steered_marigold.diffusion.checkpoints import (
    EMBEDDED,
    checkpoint_folder,
    load_marigold,
    load_pipeline,
)
from steered_marigold.diffusion.codec import DepthCodec
from steered_marigold.diffusion.light import LightMarigold
from steered_marigold.diffusion.light_ddim import LightDdim
from steered_marigold.diffusion.light_unet import LightUNet
from steered_marigold.diffusion.light_vae import LightVae
from steered_marigold.diffusion.pipeline import SteeredMarigoldPipeline
from steered_marigold.errors import CheckpointError, InputError

FOLDER = checkpoint_folder(EMBEDDED)
DTYPES = [torch.float32, torch.bfloat16]


def rand(*shape: int, seed: int = 0) -> Tensor:
    return torch.rand(*shape, generator=torch.Generator().manual_seed(seed))


def in_its_weights(light: Any, theirs: Any, dtype: torch.dtype) -> None:
    """Gives a light network the weights of one of diffusers', of which it needs a part."""
    told = light.load_state_dict(theirs.state_dict(), strict=False)
    assert not told.missing_keys
    assert all("attn2" in name or "norm2" in name for name in told.unexpected_keys)
    for network in (light, theirs):
        network.to(dtype).to(memory_format=torch.channels_last).eval()


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize(
    "sizes",
    [
        {"block_out_channels": (8, 16), "layers_per_block": 2, "attention_head_dim": 2},
        {
            "block_out_channels": (8, 8, 24),
            "down_block_types": ("CrossAttnDownBlock2D", "DownBlock2D", "CrossAttnDownBlock2D"),
            "up_block_types": ("CrossAttnUpBlock2D", "UpBlock2D", "CrossAttnUpBlock2D"),
            "layers_per_block": 1,
            "attention_head_dim": 4,
        },
    ],
)
@torch.no_grad()
def test_the_unet_is_that_of_diffusers(sizes: dict[str, Any], dtype: torch.dtype) -> None:
    """Random weights; sizes that are no multiples of the strides."""
    torch.manual_seed(0)
    kinds = {
        "down_block_types": ("DownBlock2D", "CrossAttnDownBlock2D"),
        "up_block_types": ("CrossAttnUpBlock2D", "UpBlock2D"),
    }
    theirs = UNet2DConditionModel(
        in_channels=7, out_channels=3, cross_attention_dim=8, norm_num_groups=4, **kinds | sizes
    )
    light = LightUNet(theirs.config)
    in_its_weights(light, theirs, dtype)
    x, prompt = rand(2, 7, 9, 13).to(dtype), torch.zeros(2, 5, 8, dtype=dtype)
    for t in (1, 749):
        timestep = torch.tensor(t)
        expected = theirs(x, timestep, encoder_hidden_states=prompt, return_dict=False)[0]
        assert torch.equal(light(x, timestep), expected)


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize(("widths", "layers"), [((4, 8, 8, 8), 1), ((8, 4), 2)])
@torch.no_grad()
def test_the_vae_is_that_of_diffusers(
    widths: tuple[int, ...], layers: int, dtype: torch.dtype
) -> None:
    torch.manual_seed(0)
    theirs = AutoencoderKL(
        down_block_types=("DownEncoderBlock2D",) * len(widths),
        up_block_types=("UpDecoderBlock2D",) * len(widths),
        block_out_channels=widths,
        layers_per_block=layers,
        latent_channels=3,
        norm_num_groups=4,
        mid_block_add_attention=False,
    )
    light = LightVae(theirs.config)
    in_its_weights(light, theirs, dtype)
    expected, found = DepthCodec(theirs), DepthCodec(light)
    depth, latents = 2 * rand(2, 24, 40) - 1, rand(2, 3, 5, 7).to(dtype)
    assert torch.equal(found.encode(depth), expected.encode(depth))
    assert torch.equal(found.decode(latents), expected.decode(latents))


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("steps", [1, 3, 7, 50, 1000])
def test_the_scheduler_is_that_of_diffusers(steps: int, dtype: torch.dtype) -> None:
    theirs, light = DDIMScheduler.from_pretrained(FOLDER / "scheduler"), LightDdim()
    assert torch.equal(light.alphas_cumprod, theirs.alphas_cumprod)
    theirs.set_timesteps(steps)
    light.set_timesteps(steps)
    assert torch.equal(light.timesteps, theirs.timesteps)
    velocity, latents = (rand(2, 4, 5, 6, seed=seed).to(dtype) for seed in (1, 2))
    for t in theirs.timesteps[:: max(1, steps // 7)]:
        found, expected = light.step(velocity, t, latents), theirs.step(velocity, t, latents)
        assert torch.equal(found["prev_sample"], expected["prev_sample"])
        assert torch.equal(found["pred_original_sample"], expected["pred_original_sample"])
        noisy = theirs.add_noise(latents, velocity, t[None])
        assert torch.equal(light.add_noise(latents, velocity, t[None]), noisy)


@pytest.fixture(scope="module")
def image() -> Tensor:
    return rand(3, 60, 90)


@pytest.mark.parametrize("dtype", ["float32", "auto"])
def test_answers_are_those_of_the_pipeline(image: Tensor, dtype: str) -> None:
    """To the bit, also where a preset asks for a scheduler of diffusers."""
    light, theirs = (f(device="cpu", dtype=dtype) for f in (load_marigold, load_pipeline))
    assert isinstance(light, LightMarigold)
    depth = 1 + rand(60, 90, seed=3)
    mask = rand(60, 90, seed=4) < 0.1
    for pipe in (light, theirs):
        pipe.set_progress_bar_config(disable=True)
    calls: list[dict[str, Any]] = [
        {"preset": "default"},
        {"preset": "fast", "num_inference_steps": 3, "steering_strength": 0.1},
        {"preset": "paper", "num_inference_steps": 2, "processing_resolution": 96},
        {"preset": None, "ensemble_size": 3},
    ]
    for call in calls:
        found, expected = (
            pipe(image, depth, mask, generator=torch.Generator().manual_seed(0), **call)
            for pipe in (light, theirs)
        )
        assert torch.equal(found.depth, expected.depth)
        assert torch.equal(found.affine_depth, expected.affine_depth)


def test_complete_imports_neither_diffusers_nor_transformers(tmp_path: Path) -> None:
    """Their import takes seconds, which everybody would wait for who completes one frame."""
    sample = FOLDER.parent / "sample"
    words = ["complete", *map(str, (sample / "image.jpg", sample / "depth.png"))]
    code = (
        "import sys; from steered_marigold.cli import main\n"
        "try: main()\n"
        "finally: print(sorted({'diffusers', 'transformers', 'accelerate'} & set(sys.modules)))"
    )
    output = tmp_path / "dense.png"
    for preset in ("default", "fast"):
        command = [sys.executable, "-c", code, *words, "-o", str(output), "--preset", preset]
        ran = subprocess.run(command, capture_output=True, text=True, check=True)
        assert ran.stdout.splitlines()[-1] == "[]"
    assert output.is_file()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """The embedded checkpoint, to be changed: files are links, which a change replaces."""
    copy = tmp_path / "checkpoint"
    for path in FOLDER.rglob("*"):
        if path.is_file():
            target = copy / path.relative_to(FOLDER)
            target.parent.mkdir(parents=True, exist_ok=True)
            target.symlink_to(path)
    return copy


def replace(path: Path, content: str | bytes) -> None:
    path.unlink()
    path.write_bytes(content if isinstance(content, bytes) else content.encode())


def change(path: Path, **values: object) -> None:
    replace(path, json.dumps(json.loads(path.read_text()) | values))


def change_prompt(folder: Path) -> None:
    """Another text encoder, whose embedding of the prompt is not 0."""
    path = folder / "text_encoder" / "model.safetensors"
    weights = load_file(path)
    weights["final_layer_norm.bias"][0] = 1
    path.unlink()
    save_file(weights, path)


@pytest.mark.parametrize(
    "spoil",
    [
        change_prompt,
        lambda folder: change(folder / "unet" / "config.json", freq_shift=1),
        lambda folder: change(folder / "vae" / "config.json", norm_num_groups=4),
        lambda folder: change(
            folder / "scheduler" / "scheduler_config.json", timestep_spacing="leading"
        ),
        lambda folder: change(
            folder / "model_index.json", scheduler=["diffusers", "DDPMScheduler"]
        ),
    ],
    ids=["prompt", "U-Net", "VAE", "spacing", "scheduler"],
)
def test_other_checkpoints_are_left_to_diffusers(
    folder: Path, spoil: Callable[[Path], None]
) -> None:
    assert isinstance(load_marigold(str(folder), device="cpu"), LightMarigold)
    spoil(folder)
    assert isinstance(load_marigold(str(folder), device="cpu"), SteeredMarigoldPipeline)


def test_another_scale_of_latents_is_read(folder: Path) -> None:
    change(folder / "vae" / "config.json", scaling_factor=0.5)
    light = load_marigold(str(folder), device="cpu")
    assert isinstance(light, LightMarigold)
    assert DepthCodec(light.vae).scale == 0.5


def test_damaged_weights_are_named(folder: Path) -> None:
    (path,) = (folder / "vae").glob("*.safetensors")
    weights = load_file(path)
    weights["other.weight"] = weights.pop("encoder.conv_in.weight")
    path.unlink()
    save_file(weights, path)
    with pytest.raises(CheckpointError, match=r"1 weights of 'vae' .* encoder\.conv_in\.weight"):
        load_marigold(str(folder), device="cpu")
    replace(path, path.read_bytes()[:100])
    with pytest.raises(CheckpointError, match=r"cannot be loaded: .*vae.* cannot be read"):
        load_marigold(str(folder), device="cpu")


@pytest.mark.parametrize(
    "wrong", ["a.jpg", torch.zeros(4, 8, 8), torch.zeros(8, 8), torch.full((3, 8, 8), 2.0)]
)
def test_what_is_no_image_is_refused(wrong: Any) -> None:
    with pytest.raises(InputError, match="`image` must"):
        load_marigold(device="cpu")(wrong)
