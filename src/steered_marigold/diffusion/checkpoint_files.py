"""A checkpoint's folder, checked before anything of it is loaded: nothing in it names an import."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from steered_marigold.errors import CheckpointError

REQUIRED = ("unet", "vae", "text_encoder", "scheduler", "tokenizer")
OPTIONAL = ("image_encoder", "steering_vae")
MODELS = ("unet", "vae", "text_encoder", "image_encoder", "steering_vae")
_SCHEDULERS = (
    "DDIMScheduler",
    "DDPMScheduler",
    "LCMScheduler",
    "DDIMParallelScheduler",
    "DDPMParallelScheduler",
)
# the classes that each component may be, and their modules, of which none is imported here;
# transformers' tokenizers had a fast twin of the same files
CLASSES: Mapping[str, Mapping[str, str]] = {
    "unet": {"UNet2DConditionModel": "diffusers"},
    "vae": {"AutoencoderKL": "diffusers"},
    "text_encoder": {"CLIPTextModel": "transformers"},
    "tokenizer": {"CLIPTokenizer": "transformers", "CLIPTokenizerFast": "transformers"},
    "scheduler": dict.fromkeys(_SCHEDULERS, "diffusers"),
    "image_encoder": {"ImageEncoder": "steered_marigold.diffusion.image_encoder"},
    "steering_vae": {"AutoencoderTiny": "diffusers"},
}
# the pipeline's own settings, with their types
_SETTINGS: Mapping[str, tuple[type, ...]] = {
    "prediction_type": (str, type(None)),
    "scale_invariant": (bool, type(None)),
    "shift_invariant": (bool, type(None)),
    "default_denoising_steps": (int, type(None)),
    "default_processing_resolution": (int, type(None)),
    "continues_known": (bool,),
}
# in a component's configuration these make libraries import or fetch more
_REFUSED_SETTINGS = ("auto_map", "quantization_config", "custom_pipeline")
# far above what any depth model has; a damaged size must not take all memory or time
_LARGEST_NUMBER = 1_000_000
_MOST_LAYERS = 1000


def read_index(folder: Path, checkpoint: str) -> tuple[dict[str, str], dict[str, Any]]:
    """Each component's class, and the pipeline's settings, of a folder that has all files.

    A class is its module and name, such as "diffusers.UNet2DConditionModel". checkpoint: its name
    in messages. Raises CheckpointError for what is missing, no JSON, pickled, of a class that is
    not listed in CLASSES, or no depth checkpoint.
    """
    index_file = folder / "model_index.json"
    if not index_file.is_file():
        raise CheckpointError(f"checkpoint {checkpoint} has no model_index.json in {folder}")
    index = read_json(index_file)
    components = {
        name: _class_of(name, index.get(name), index_file)
        for name in (*REQUIRED, *OPTIONAL)
        if _is_given(index.get(name))
    }
    for name, value in index.items():
        if isinstance(value, list) and _is_given(value) and name not in CLASSES:
            raise CheckpointError(f"{index_file}: a depth checkpoint has no component {name!r}")
    for name in REQUIRED:
        if name not in components:
            raise CheckpointError(f"checkpoint {checkpoint} has no component {name!r}")
    for name in components:
        _check_component(folder / name, name, checkpoint)
    settings = {name: index[name] for name in _SETTINGS if name in index}
    for name, value in settings.items():
        if not isinstance(value, _SETTINGS[name]) or (type(value) is int and not 0 < value < 10**5):
            raise CheckpointError(f"{index_file}: {name} cannot be {value!r}")
    if settings.get("prediction_type") not in (None, "depth"):
        raise CheckpointError(
            f"checkpoint {checkpoint} predicts {settings['prediction_type']}, not depth"
        )
    return components, settings


def require_complete(folder: Path, lacking: Sequence[str]) -> None:
    """CheckpointError if weights of a component lack, which would be random numbers."""
    if lacking:
        raise CheckpointError(
            f"{len(lacking)} weights of {folder.name!r} are missing or of another shape, such as "
            f"{min(lacking)}"
        )


def checksum(folder: Path) -> str:
    """SHA-256 of a checkpoint's files and their names, as hexadecimal digits."""
    total = hashlib.sha256()
    parts = [folder / name for name in (*REQUIRED, *OPTIONAL)]
    used = [folder / "model_index.json", *(p for part in parts for p in sorted(part.glob("*")))]
    for path in used:
        if path.is_file() and path.suffix in (".json", ".safetensors", ".txt"):
            with path.open("rb") as file:
                digest = hashlib.file_digest(file, "sha256").hexdigest()
            total.update(f"{path.relative_to(folder).as_posix()} {digest}\n".encode())
    return total.hexdigest()


def _is_given(value: Any) -> bool:
    """[null, null] stands for an optional component that there is not."""
    return bool(value) and value != [None, None]


def _class_of(name: str, value: Any, index_file: Path) -> str:
    """Module and name of the listed class that the index names for a component."""
    kinds = CLASSES[name]
    library, kind = value if isinstance(value, list) and len(value) == 2 else (None, None)
    home = kinds.get(kind) if isinstance(kind, str) else None
    if home is None or library not in (home, home.partition(".")[0]):
        raise CheckpointError(
            f"{index_file}: {name!r} is {json.dumps(value)}; it can be {' or '.join(kinds)}, and "
            "no other class is loaded"
        )
    return f"{home}.{str(kind).removesuffix('Fast')}"


def _check_component(folder: Path, name: str, checkpoint: str) -> None:
    """Its files are there, and its configurations ask for nothing that is not in them."""
    if not folder.is_dir():
        raise CheckpointError(f"checkpoint {checkpoint} has no component {name!r}")
    for path in sorted(folder.glob("*config.json")):
        config = read_json(path)
        for refused in _REFUSED_SETTINGS:
            if config.get(refused):
                raise CheckpointError(f"{path}: {refused} is never followed; remove it")
        _check_numbers(config, path)
    if name in MODELS and not list(folder.glob("*.safetensors")):
        pickled = [path.name for path in folder.glob("*.bin")]
        found = f"only {pickled[0]}, a pickle, which is never loaded" if pickled else "no weights"
        raise CheckpointError(
            f"checkpoint {checkpoint} has no safetensors in {name!r} (found {found})"
        )


def _check_numbers(value: Any, path: Path, name: str = "") -> None:
    """CheckpointError for a size that no model has."""
    if isinstance(value, Mapping):
        for key, item in value.items():
            _check_numbers(item, path, str(key))
    elif isinstance(value, list):
        for item in value:
            _check_numbers(item, path, name)
    elif isinstance(value, int):
        most = _MOST_LAYERS if "layers" in name or "blocks" in name else _LARGEST_NUMBER
        if abs(value) > most and name != "model_max_length":
            raise CheckpointError(f"{path}: {name} cannot be {value}")


def read_json(path: Path) -> dict[str, Any]:
    """The object in a file; CheckpointError if there is none."""
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise CheckpointError(f"{path} is not valid JSON: {error}") from error
    if not isinstance(values, dict):
        raise CheckpointError(f"{path} holds no JSON object")
    return values
