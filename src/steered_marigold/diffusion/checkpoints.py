"""A checkpoint's name to a loaded pipeline: "embedded", a local folder, or a hub id."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import torch

from steered_marigold.diffusion.checkpoint_files import CLASSES, read_index, require_complete
from steered_marigold.diffusion.light import is_light, load_light
from steered_marigold.diffusion.marigold import SteeredMarigold
from steered_marigold.errors import CheckpointError, InputError

if TYPE_CHECKING:
    from steered_marigold.diffusion.pipeline import SteeredMarigoldPipeline

EMBEDDED = "embedded"
# a hub that does not answer must not keep anyone waiting
HUB_TIMEOUT_S = 10
DTYPES = ("auto", "float32", "bfloat16", "float16")
Kind = TypeVar("Kind", bound=SteeredMarigold)


def load_marigold(
    checkpoint: str = EMBEDDED,
    *,
    device: str | torch.device | None = None,
    dtype: torch.dtype | str = torch.float32,
    compiled: bool = False,
) -> SteeredMarigold:
    """What completes depth with a checkpoint: without diffusers for those like the embedded one.

    Those load sooner, and answer as `load_pipeline`'s, to the bit on CPUs. All others are loaded by
    `load_pipeline`, whose arguments and errors these are.
    """
    folder = checkpoint_folder(checkpoint)
    if not is_light(folder, checkpoint_folder(EMBEDDED), checkpoint):
        return load_pipeline(checkpoint, device=device, dtype=dtype, compiled=compiled)
    target = parse_device(device)
    precision = parse_dtype(dtype, target)
    with _named(checkpoint):
        marigold = load_light(folder, target, precision)
    return _prepared(marigold, compiled)


def load_pipeline(
    checkpoint: str = EMBEDDED,
    *,
    device: str | torch.device | None = None,
    dtype: torch.dtype | str = torch.float32,
    compiled: bool = False,
) -> "SteeredMarigoldPipeline":
    """The pipeline of a checkpoint, on a device (None: CUDA, then MPS, then CPU).

    checkpoint: "embedded", a folder in Marigold's layout, or a hub id such as
    "prs-eth/marigold-depth-v1-1". Only safetensors are read, no code is run from a checkpoint, and
    only the classes of `checkpoint_files.CLASSES` are loaded.
    dtype: or its name; "auto" is `fastest_dtype` of the device. compiled: run the U-Net and the
    decoder through `torch.compile`; the first images of each size then take minutes.

    Raises CheckpointError if it is missing, incomplete, has pickled weights only, or is no depth
    checkpoint; InputError for a device that this machine does not have, or an unknown dtype.
    """
    from steered_marigold.diffusion.pipeline import SteeredMarigoldPipeline

    target = parse_device(device)
    precision = parse_dtype(dtype, target)
    folder = checkpoint_folder(checkpoint)
    classes, settings = read_index(folder, checkpoint)
    with _named(checkpoint), _quietly():
        parts = {name: _load(kind, folder / name, precision) for name, kind in classes.items()}
        pipeline = SteeredMarigoldPipeline(**parts, **settings)
        _try_scheduler(pipeline.scheduler)
    pipeline.to(target)
    return _prepared(pipeline, compiled)


@contextmanager
def _named(checkpoint: str) -> Iterator[None]:
    """Whatever fails inside is a CheckpointError that names the checkpoint."""
    try:
        yield
    except Exception as error:  # the libraries raise everything from KeyError to SafetensorError
        reason = " ".join(str(error).split()) or type(error).__name__
        raise CheckpointError(f"checkpoint {checkpoint} cannot be loaded: {reason}") from error


def _prepared(marigold: Kind, compiled: bool) -> Kind:
    """With convolutions' channels last, which CPUs and GPUs are faster with; compiled if asked."""
    for model in filter(None, (marigold.unet, marigold.vae, marigold.image_encoder)):
        model.to(memory_format=torch.channels_last)
    if compiled:
        marigold.unet.compile()
        marigold.vae.decoder.compile()
    return marigold


def _load(kind: str, folder: Path, dtype: torch.dtype) -> Any:
    """A component of a listed class; CheckpointError if weights are missing in its files."""
    module, _, name = kind.rpartition(".")
    cls = getattr(import_module(module), name)
    if not hasattr(cls, "load_state_dict"):  # a tokenizer or a scheduler
        return cls.from_pretrained(folder, local_files_only=True)
    model, told = cls.from_pretrained(
        folder, dtype=dtype, use_safetensors=True, local_files_only=True, output_loading_info=True
    )
    require_complete(folder, [*told["missing_keys"], *map(str, told["mismatched_keys"])])
    return model.eval()


def _try_scheduler(scheduler: Any) -> None:
    """One step on nothing: raises what a damaged configuration makes it raise."""
    nothing = torch.zeros(1, 1, 1, 1)
    scheduler = type(scheduler).from_config(scheduler.config)
    scheduler.set_timesteps(1)
    scheduler.step(nothing, scheduler.timesteps[0], nothing, return_dict=True)


@contextmanager
def _quietly() -> Iterator[None]:
    """Without the libraries' progress bars and reports: stderr is the caller's."""
    from diffusers.utils import logging as diffusers_logging
    from transformers.utils import logging as transformers_logging

    libraries = (diffusers_logging, transformers_logging)
    shown = [library for library in libraries if library.is_progress_bar_enabled()]
    levels = [library.get_verbosity() for library in libraries]
    for library in libraries:
        library.disable_progress_bar()
        library.set_verbosity(library.CRITICAL)
    try:
        yield
    finally:
        for library, level in zip(libraries, levels, strict=True):
            library.set_verbosity(level)
        for library in shown:
            library.enable_progress_bar()


def fastest_dtype(device: torch.device) -> torch.dtype:
    """The precision with matrix instructions: half on CUDA, bfloat16 on CPUs that have them."""
    if device.type == "cuda":
        return torch.bfloat16 if torch.cuda.is_bf16_supported(False) else torch.float16
    if device.type == "cpu":
        features = torch.cpu.get_capabilities()
        if features.get("avx512_bf16") or features.get("amx_bf16"):
            return torch.bfloat16
    return torch.float32


def parse_dtype(dtype: torch.dtype | str, device: torch.device) -> torch.dtype:
    """A precision by its name; InputError for others than `DTYPES`."""
    if isinstance(dtype, torch.dtype):
        return dtype
    if dtype not in DTYPES:
        raise InputError(f"`dtype` is {dtype!r}: choose one of {', '.join(DTYPES)}")
    return fastest_dtype(device) if dtype == "auto" else getattr(torch, dtype)


def default_device() -> torch.device:
    """The best there is: CUDA, then MPS, then CPU."""
    if torch.cuda.is_available():
        return torch.device("cuda")
    return torch.device("mps" if torch.backends.mps.is_available() else "cpu")


def parse_device(device: str | torch.device | None) -> torch.device:
    """None is the best there is; InputError for one that this machine does not have."""
    if device is None:
        return default_device()
    try:
        torch.empty(0, device=device)
    except (RuntimeError, AssertionError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(f"`device` {device!s} cannot be used: {reason}") from error
    return torch.device(device)


def checkpoint_folder(checkpoint: str) -> Path:
    """The local folder of a checkpoint; a hub id is downloaded first.

    Raises CheckpointError if there is none.
    """
    if checkpoint == EMBEDDED:
        return Path(str(files("steered_marigold") / "assets" / "checkpoint"))
    if Path(checkpoint).is_dir():
        return Path(checkpoint)
    if len(checkpoint.split("/")) != 2 or checkpoint.startswith((".", "/", "~")):
        raise CheckpointError(
            f"checkpoint {checkpoint} is neither {EMBEDDED!r}, an existing folder nor a hub id"
        )
    os.environ.setdefault("HF_HUB_DOWNLOAD_TIMEOUT", str(HUB_TIMEOUT_S))
    from huggingface_hub import snapshot_download

    patterns = ["model_index.json", "tokenizer/*"]
    patterns += [f"{c}/*.{kind}" for c in CLASSES for kind in ("json", "safetensors")]
    try:
        return Path(
            snapshot_download(checkpoint, allow_patterns=patterns, etag_timeout=HUB_TIMEOUT_S)
        )
    except Exception as error:  # the hub's client raises kinds of several libraries
        reason = str(error).strip().splitlines()
        raise CheckpointError(
            f"checkpoint {checkpoint} is not on this machine and could not be downloaded "
            f"({type(error).__name__}: {reason[0] if reason else 'no answer'}); "
            f"check the name and the network, or use `checkpoint={EMBEDDED}`"
        ) from error
