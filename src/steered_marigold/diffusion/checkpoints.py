"""A checkpoint's name to a loaded pipeline: "embedded", a local folder, or a hub id."""

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.resources import files
from pathlib import Path
from typing import Any

import torch
from diffusers.utils import logging as diffusers_logging
from transformers.utils import logging as transformers_logging

from steered_marigold.diffusion.pipeline import SteeredMarigoldPipeline
from steered_marigold.errors import CheckpointError, InputError

EMBEDDED = "embedded"
MODELS = ("unet", "vae", "text_encoder")
COMPONENTS = (*MODELS, "scheduler", "tokenizer")
# a hub that does not answer must not keep anyone waiting
HUB_TIMEOUT_S = 10
DTYPES = ("auto", "float32", "bfloat16", "float16")


def load_pipeline(
    checkpoint: str = EMBEDDED,
    *,
    device: str | torch.device | None = None,
    dtype: torch.dtype | str = torch.float32,
    compiled: bool = False,
) -> SteeredMarigoldPipeline:
    """The pipeline of a checkpoint, on a device (None: CUDA, then MPS, then CPU).

    checkpoint: "embedded", a folder in Marigold's layout, or a hub id such as
    "prs-eth/marigold-depth-v1-1". Only safetensors are read, and no code is run from a checkpoint.
    dtype: or its name; "auto" is `fastest_dtype` of the device. compiled: run the U-Net and the
    decoder through `torch.compile`; the first images of each size then take minutes.

    Raises CheckpointError if it is missing, incomplete, has pickled weights only, or is no depth
    checkpoint; InputError for a device that this machine does not have, or an unknown dtype.
    """
    target = default_device() if device is None else _device(device)
    precision = parse_dtype(dtype, target)
    folder = _folder(checkpoint)
    _check_folder(folder, checkpoint)
    try:
        with _quietly():
            pipeline: SteeredMarigoldPipeline = SteeredMarigoldPipeline.from_pretrained(
                folder,
                dtype=precision,
                use_safetensors=True,
                local_files_only=True,
            )
    except (OSError, ValueError, KeyError, TypeError, RuntimeError) as error:
        raise CheckpointError(f"checkpoint {checkpoint} cannot be loaded: {error}") from error
    pipeline.to(target)
    for model in filter(None, (pipeline.unet, pipeline.vae, pipeline.image_encoder)):
        model.to(memory_format=torch.channels_last)
    if compiled:
        pipeline.unet.compile()
        pipeline.vae.decoder.compile()
    return pipeline


@contextmanager
def _quietly() -> Iterator[None]:
    """Without the libraries' progress bars: stderr is the caller's."""
    shown = [
        library
        for library in (diffusers_logging, transformers_logging)
        if library.is_progress_bar_enabled()
    ]
    for library in shown:
        library.disable_progress_bar()
    try:
        yield
    finally:
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


def _device(device: str | torch.device) -> torch.device:
    try:
        torch.empty(0, device=device)
    except (RuntimeError, AssertionError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(f"`device` {device!s} cannot be used: {reason}") from error
    return torch.device(device)


def _folder(checkpoint: str) -> Path:
    """The local folder of a checkpoint; a hub id is downloaded first."""
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

    patterns = ["model_index.json", *(f"{c}/*.json" for c in COMPONENTS)]
    patterns += [f"{c}/*.safetensors" for c in MODELS]
    patterns += ["tokenizer/*", "image_encoder/*.json", "image_encoder/*.safetensors"]
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


def _check_folder(folder: Path, checkpoint: str) -> None:
    """Names what a checkpoint folder lacks before diffusers trips over it."""
    index_file = folder / "model_index.json"
    if not index_file.is_file():
        raise CheckpointError(f"checkpoint {checkpoint} has no model_index.json in {folder}")
    try:
        index: dict[str, Any] = json.loads(index_file.read_text())
    except ValueError as error:
        raise CheckpointError(f"{index_file} is not valid JSON: {error}") from error
    for component in COMPONENTS:
        if component not in index or not (folder / component).is_dir():
            raise CheckpointError(f"checkpoint {checkpoint} has no component {component!r}")
    models = [*MODELS, *(["image_encoder"] if index.get("image_encoder", [None])[0] else [])]
    for model in models:
        if list((folder / model).glob("*.safetensors")):
            continue
        pickled = [p.name for p in (folder / model).glob("*.bin")]
        found = f"only {pickled[0]}, a pickle, which is never loaded" if pickled else "no weights"
        raise CheckpointError(
            f"checkpoint {checkpoint} has no safetensors in {model!r} (found {found})"
        )
    if index.get("prediction_type") not in (None, "depth"):
        raise CheckpointError(
            f"checkpoint {checkpoint} predicts {index['prediction_type']}, not depth"
        )
