"""Names of checkpoints, and what a damaged one says."""

import json
import shutil
import sys
from pathlib import Path

import pytest
import torch
from diffusers import AutoencoderKL, UNet2DConditionModel
from safetensors.torch import load_file, save_file

from steered_marigold.diffusion.checkpoint_files import checksum
from steered_marigold.diffusion.checkpoints import fastest_dtype, load_pipeline
from steered_marigold.diffusion.pipeline import SteeredMarigoldPipeline
from steered_marigold.errors import CheckpointError, InputError


@pytest.fixture
def folder(pipeline: SteeredMarigoldPipeline, tmp_path: Path) -> Path:
    """A saved checkpoint."""
    pipeline.save_pretrained(tmp_path / "checkpoint")
    return tmp_path / "checkpoint"


def test_loads_a_folder_in_the_dtype_asked_for(folder: Path) -> None:
    pipeline = load_pipeline(str(folder), device="cpu", dtype=torch.bfloat16)
    assert pipeline.unet.dtype == torch.bfloat16
    assert pipeline.image_encoder is None


def test_auto_is_what_the_device_is_fastest_in(folder: Path) -> None:
    assert load_pipeline(str(folder), device="cpu").unet.dtype == torch.float32
    pipeline = load_pipeline(str(folder), device="cpu", dtype="auto")
    assert pipeline.unet.dtype == fastest_dtype(torch.device("cpu"))
    features = torch.cpu.get_capabilities()
    has_bfloat16 = bool(features.get("avx512_bf16") or features.get("amx_bf16"))
    assert (pipeline.unet.dtype == torch.bfloat16) == has_bfloat16


@pytest.mark.parametrize("component", ["unet", "vae", "text_encoder", "scheduler", "tokenizer"])
def test_a_missing_component_is_named(folder: Path, component: str) -> None:
    shutil.rmtree(folder / component)
    with pytest.raises(CheckpointError, match=component):
        load_pipeline(str(folder), device="cpu")


def test_pickled_weights_are_refused(folder: Path) -> None:
    for file in (folder / "unet").glob("*.safetensors"):
        file.rename(file.with_name("diffusion_pytorch_model.bin"))
    with pytest.raises(CheckpointError, match=r"'unet'.*pickle"):
        load_pipeline(str(folder), device="cpu")


def test_damaged_weights_are_named(folder: Path) -> None:
    for file in (folder / "vae").glob("*.safetensors"):
        file.write_bytes(file.read_bytes()[:100])
    with pytest.raises(CheckpointError, match="cannot be loaded"):
        load_pipeline(str(folder), device="cpu")


def test_other_predictions_than_depth_are_refused(folder: Path) -> None:
    index = json.loads((folder / "model_index.json").read_text())
    (folder / "model_index.json").write_text(json.dumps(index | {"prediction_type": "disparity"}))
    with pytest.raises(CheckpointError, match="disparity"):
        load_pipeline(str(folder), device="cpu")


def test_a_folder_without_index(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match=r"model_index\.json"):
        load_pipeline(str(tmp_path), device="cpu")


@pytest.mark.parametrize("name", ["no/such/folder", "./missing", "nothing"])
def test_a_name_that_is_nothing(name: str) -> None:
    with pytest.raises(CheckpointError, match=name):
        load_pipeline(name, device="cpu")


def test_a_hub_id_without_network_says_so_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_OFFLINE", True)
    with pytest.raises(CheckpointError, match="could not be downloaded") as caught:
        load_pipeline("prs-eth/no-such-checkpoint", device="cpu")
    assert "\n" not in str(caught.value)


def test_a_device_that_is_not_there(folder: Path) -> None:
    with pytest.raises(InputError, match="`device` toaster cannot be used"):
        load_pipeline(str(folder), device="toaster")


def test_an_unknown_precision(folder: Path) -> None:
    with pytest.raises(InputError, match="`dtype` is 'int8': choose one of auto, float32"):
        load_pipeline(str(folder), device="cpu", dtype="int8")


def test_stable_diffusion_2_shapes() -> None:
    """Marigold's U-Net and VAE at their real size, without their memory."""
    with torch.device("meta"):
        unet = UNet2DConditionModel(
            in_channels=8,
            out_channels=4,
            block_out_channels=(320, 640, 1280, 1280),
            layers_per_block=2,
            cross_attention_dim=1024,
            attention_head_dim=(5, 10, 20, 20),
            use_linear_projection=True,
        )
        vae = AutoencoderKL(
            down_block_types=("DownEncoderBlock2D",) * 4,
            up_block_types=("UpDecoderBlock2D",) * 4,
            block_out_channels=(128, 256, 512, 512),
            layers_per_block=2,
            latent_channels=4,
        )
        assert sum(p.numel() for p in unet.parameters()) == pytest.approx(865.922e6, rel=1e-6)
        assert sum(p.numel() for p in vae.parameters()) == pytest.approx(83.654e6, rel=1e-5)
        latents = vae.encode(torch.empty(1, 3, 448, 608)).latent_dist.mode()
        both = torch.cat([latents, latents], dim=1)
        t, text = torch.tensor(981), torch.empty(1, 77, 1024)
        velocity = unet(both, t, encoder_hidden_states=text, return_dict=False)[0]
        assert velocity.shape == latents.shape == (1, 4, 56, 76)
        assert vae.decode(velocity, return_dict=False)[0].shape == (1, 3, 448, 608)


@pytest.mark.parametrize(
    ("component", "value"),
    [
        ("unet", ["antigravity", "UNet2DConditionModel"]),
        ("scheduler", ["evil_module", "Scheduler"]),
        ("image_encoder", ["evil_module", "ImageEncoder"]),
        ("vae", ["diffusers", "FluxTransformer2DModel"]),
        ("safety_checker", ["evil_module", "Checker"]),
        ("tokenizer", "CLIPTokenizer"),
        ("vae", ["diffusers", ["AutoencoderKL"]]),
    ],
)
def test_only_listed_classes_are_loaded(
    folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    component: str,
    value: object,
) -> None:
    """A module of the name that an index gives is not even imported."""
    (tmp_path / "evil_module.py").write_text("raise SystemExit('imported')")
    monkeypatch.syspath_prepend(tmp_path)
    index = json.loads((folder / "model_index.json").read_text())
    (folder / "model_index.json").write_text(json.dumps(index | {component: value}))
    with pytest.raises(CheckpointError, match=component):
        load_pipeline(str(folder), device="cpu")
    assert not {"evil_module", "antigravity"} & set(sys.modules)


@pytest.mark.parametrize("key", ["auto_map", "quantization_config"])
def test_configurations_that_fetch_code_are_refused(folder: Path, key: str) -> None:
    path = folder / "unet" / "config.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {key: {"AutoModel": "x.Y"}}))
    with pytest.raises(CheckpointError, match=f"{key} is never followed"):
        load_pipeline(str(folder), device="cpu")


def test_weights_under_another_name_are_missed(folder: Path) -> None:
    """Else they would be random numbers."""
    (path,) = (folder / "vae").glob("*.safetensors")
    weights = load_file(path)
    weights["other.weight"] = weights.pop("encoder.conv_in.weight")
    save_file(weights, path)
    with pytest.raises(CheckpointError, match=r"1 weights of 'vae' .* encoder\.conv_in\.weight"):
        load_pipeline(str(folder), device="cpu")


def test_a_checksum_is_of_contents_wherever_they_lie(folder: Path, tmp_path: Path) -> None:
    before = checksum(folder)
    assert checksum(folder.rename(tmp_path / "moved")) == before
    config = tmp_path / "moved" / "scheduler" / "scheduler_config.json"
    config.write_text(config.read_text() + " ")
    assert checksum(tmp_path / "moved") != before
