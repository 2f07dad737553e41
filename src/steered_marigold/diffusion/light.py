"""Checkpoints like the embedded one without diffusers and transformers, whose import takes seconds.

They have the embedded checkpoint's classes and configurations, and a text encoder of zeros, whose
embedding of the prompt is 0. The networks are those of diffusers, operation by operation.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any, TypeVar

import torch
from jaxtyping import Float
from safetensors import SafetensorError
from safetensors.torch import load_file
from torch import Tensor, nn

from steered_marigold.diffusion.checkpoint_files import read_index, read_json, require_complete
from steered_marigold.diffusion.image_network import ImageNetwork
from steered_marigold.diffusion.light_ddim import LightDdim
from steered_marigold.diffusion.light_unet import LightUNet
from steered_marigold.diffusion.light_vae import LightVae
from steered_marigold.diffusion.marigold import SteeredMarigold
from steered_marigold.errors import CheckpointError, InputError

# settings that may differ from the embedded checkpoint's: what wrote them, and what `load_light`
# reads
_FREE_SETTINGS = ("_diffusers_version", "transformers_version", "dtype", "scaling_factor")
Network = TypeVar("Network", bound=nn.Module)


class LightMarigold(SteeredMarigold):
    """`SteeredMarigold` in plain torch, for images that are tensors.

    scheduler_config: of diffusers' scheduler, for presets that ask for another one. settings: of
    the pipeline.
    """

    vae_scale_factor = 8
    steering_vae = None

    def __init__(
        self,
        networks: tuple[LightUNet, LightVae, ImageNetwork],
        scheduler_config: Mapping[str, Any],
        settings: Mapping[str, Any],
    ) -> None:
        self.unet, self.vae, self.image_encoder = networks
        self._scheduler_config = dict(scheduler_config)
        self.config = SimpleNamespace(**{"continues_known": False, **settings})
        self.default_denoising_steps = settings["default_denoising_steps"]
        self.default_processing_resolution = settings["default_processing_resolution"]
        weight = self.unet.conv_in.weight
        self.device = self._execution_device = weight.device
        self.dtype = weight.dtype
        self._progress: dict[str, Any] = {}

    def load_images(self, image: Any) -> Float[Tensor, "images 3 height width"]:
        if not torch.is_tensor(image) or image.shape[-3:-2] != (3,) or image.ndim > 4:
            raise InputError("`image` must be a tensor [3, height, width], or a batch of them")
        if not 0 <= image.min() <= image.max() <= 1:
            raise InputError("`image` must lie in [0, 1]")
        images = image.to(self.device, torch.float32)
        return images if images.ndim == 4 else images[None]

    def predictor(
        self, image_latents: Tensor, prompt_tokens: int | None = None
    ) -> Callable[[Tensor, Tensor], Tensor]:
        def predict(latents: Tensor, t: Tensor) -> Tensor:
            output: Tensor = self.unet(torch.cat([image_latents, latents], dim=1), t)
            return output

        return predict

    def local_scheduler(self, asked: tuple[str | None, Mapping[str, Any]] | None) -> Any:
        name, changes = asked or (None, {})
        own = self._scheduler_config["_class_name"]
        if name in (None, own) and changes.items() <= self._scheduler_config.items():
            return LightDdim()
        import diffusers

        return getattr(diffusers, name or own).from_config(self._scheduler_config, **changes)

    def set_progress_bar_config(self, **config: Any) -> None:
        """Arguments of tqdm, as those of diffusers' pipelines are."""
        self._progress = config

    def progress_bar(self, total: int) -> Any:
        """A bar of so many steps."""
        from tqdm.auto import tqdm  # type: ignore[import-untyped]

        return tqdm(total=total, **self._progress)

    def maybe_free_model_hooks(self) -> None:
        """Nothing is offloaded."""


def is_light(folder: Path, embedded: Path, checkpoint: str) -> bool:
    """Whether a checkpoint's folder is so like the embedded one's that `load_light` can read it.

    checkpoint: its name in messages. Raises the CheckpointErrors of `read_index`.
    """
    classes, settings = read_index(folder, checkpoint)
    if classes != read_index(embedded, "embedded")[0]:
        return False
    if not {"default_denoising_steps", "default_processing_resolution"} <= settings.keys():
        return False
    if any(_settings(folder / name) != _settings(embedded / name) for name in classes):
        return False
    return not any(bool(w.any()) for w in _read_weights(folder / "text_encoder").values())


def load_light(folder: Path, device: torch.device, dtype: torch.dtype) -> LightMarigold:
    """A checkpoint for which `is_light`.

    Raises CheckpointError for missing or damaged weights, RuntimeError for some of another shape.
    """
    _, settings = read_index(folder, folder.name)
    configs = {name: read_json(folder / name / "config.json") for name in ("unet", "vae")}
    image = {k: v for k, v in _settings(folder / "image_encoder").items() if not k.startswith("_")}
    with torch.device("meta"):  # no memory and no random numbers: the weights are read
        unet, vae = LightUNet(configs["unet"]), LightVae(configs["vae"])
        encoder = ImageNetwork(**image)
    networks = (
        _fill(unet, folder / "unet", device, dtype),
        _fill(vae, folder / "vae", device, dtype),
        _fill(encoder, folder / "image_encoder", device, dtype),
    )
    scheduler_config = read_json(folder / "scheduler" / "scheduler_config.json")
    return LightMarigold(networks, scheduler_config, settings)


def _settings(folder: Path) -> dict[str, Any]:
    """A component's configuration, without what may differ."""
    config: dict[str, Any] = {}
    for path in sorted(folder.glob("*config.json")):
        config |= read_json(path)
    return {key: value for key, value in config.items() if key not in _FREE_SETTINGS}


def _fill(network: Network, folder: Path, device: torch.device, dtype: torch.dtype) -> Network:
    """The network with the weights of a folder."""
    weights = {name: w.to(device, dtype) for name, w in _read_weights(folder).items()}
    told = network.load_state_dict(weights, strict=False, assign=True)
    require_complete(folder, told.missing_keys)
    return network.eval().requires_grad_(False)


def _read_weights(folder: Path) -> dict[str, Tensor]:
    """The tensors of a component's files; CheckpointError for damaged files."""
    weights: dict[str, Tensor] = {}
    for path in sorted(folder.glob("*.safetensors")):
        try:
            weights |= load_file(path)
        except (OSError, SafetensorError) as error:
            raise CheckpointError(f"{path} cannot be read: {error}") from error
    return weights
