"""steered-marigold doctor: what is here, and whether it works."""

import platform
from importlib.metadata import PackageNotFoundError, version
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from time import perf_counter

import typer

# a module of each extra, by the extra's name
EXTRAS = {
    "app": "gradio",
    "eval": "h5py",
    "heif": "pillow_heif",
    "ray": "ray",
    "remote": "pyarrow",
    "rerun": "rerun",
    "ros": "rosbags",
}
# instruction sets that change how fast, and in which precision, a CPU computes
INSTRUCTIONS = ("avx2", "avx512_f", "avx512_bf16", "amx_bf16")
PACKAGES = ("steered-marigold", "torch", "diffusers", "transformers", "numpy", "scipy")


def doctor() -> None:
    """Say versions, devices and extras, and complete the sample frame once."""
    for name in PACKAGES:
        print(f"{name} {_version(name)}")
    print(f"Python {platform.python_version()}, {platform.platform(terse=True)}")
    missing = [extra for extra, module in EXTRAS.items() if find_spec(module) is None]
    print(f"extras here: {', '.join(extra for extra in EXTRAS if extra not in missing) or 'none'}")
    if missing:
        print(f"extras not here: pip install 'steered-marigold[{','.join(missing)}]'")
    print(_devices())
    print(_self_test())


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "is not installed"


def _devices() -> str:
    import torch

    from steered_marigold.diffusion.checkpoints import default_device, fastest_dtype

    device = default_device()
    there = torch.cpu.get_capabilities()
    features = [name for name in INSTRUCTIONS if there.get(name)]
    fast = str(fastest_dtype(device)).removeprefix("torch.")
    cpu = ", ".join([f"{torch.get_num_threads()} threads", *features])
    return f"runs on {device} in {fast}; CPU with {cpu}"


def _self_test() -> str:
    """Completes the sample; exit code 1 if that gives no depth."""
    from steered_marigold.frames.complete import complete_frame
    from steered_marigold.frames.sources import FrameFiles, Reading, read_frame
    from steered_marigold.methods.steered import SteeredCompleter

    sample = Path(str(files("steered_marigold") / "assets" / "sample"))
    frame_files = FrameFiles(image=sample / "image.jpg", depth=sample / "depth.png")
    started = perf_counter()
    completer = SteeredCompleter.from_checkpoint(preset="fast")
    loaded = perf_counter()
    completion, record = complete_frame(completer, read_frame(frame_files, Reading()))
    again, record = complete_frame(completer, read_frame(frame_files, Reading()))
    if not (completion.depth > 0).all() or not completion.depth.equal(again.depth):
        print("self-test failed: the sample frame gives no depth, or not twice the same")
        raise typer.Exit(1)
    return (
        f"self-test passed: loaded in {loaded - started:.1f} s, a 640x480 frame takes "
        f"{record.values['seconds']:.2f} s with preset fast"
    )
