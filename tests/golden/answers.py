"""The answers that `answers.npz` keeps: what a change that is meant to change nothing must give.

`python -m tests.golden.answers` writes the file anew; say in the commit why answers differ.
"""

import json
import platform
from importlib.resources import files
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from steered_marigold import SteeredCompleter
from steered_marigold.io.depth_maps import read_depth
from steered_marigold.io.images import read_image

FILE = Path(__file__).with_name("answers.npz")
PRESETS = ("default", "fast", "paper")
# every so many pixels, rows and columns alike, of the sample frame and of the drawn ones
STRIDES = {"sample": 7, "corridor": 3, "table": 3}

Picture = tuple[Tensor, Tensor, Tensor]


def picture(name: str) -> Picture:
    """(image, sparse depth [m], mask) of the sample frame, or of a drawn one."""
    if name == "sample":
        sample = Path(str(files("steered_marigold") / "assets" / "sample"))
        sensor = read_depth(sample / "depth.png")
        return read_image(sample / "image.jpg").pixels, sensor.depth, sensor.valid_mask
    return {"corridor": _corridor, "table": _table}[name]()


def _corridor() -> Picture:
    """Four receding planes, the far end out of the sensor's range."""
    y, x = np.mgrid[-1:1:120j, -1:1:160j]
    depth = 1.2 / np.maximum(np.maximum(abs(x), abs(y)), 0.15)
    shade = np.where(abs(x) > abs(y), 0.75, np.where(y > 0, 0.35, 0.95)) / (0.6 + 0.15 * depth)
    image = np.stack([shade, 0.9 * shade, 0.8 * shade], axis=-1)
    return _as_tensors(image, depth, depth < 4.5)


def _table() -> Picture:
    """A ball and a box before a slanted wall; scattered measurements, none on the ball."""
    y, x = np.mgrid[0:1:120j, 0:1:160j]
    depth = 2.5 + 0.8 * x
    image = np.stack([0.5 + 0.3 * y, 0.55 + 0.2 * x, 0.6 - 0.2 * y], axis=-1)
    box = (abs(x - 0.7) < 0.15) & (y > 0.55)
    depth[box], image[box] = 1.4, (0.7, 0.3, 0.2)
    ball = 1 - ((x - 0.35) / 0.15) ** 2 - ((y - 0.55) / 0.2) ** 2
    on_ball = ball > 0
    depth[on_ball] = 1.6 - 0.2 * np.sqrt(ball[on_ball])
    image[on_ball] = np.sqrt(ball[on_ball])[:, None] * (0.2, 0.5, 0.8)
    measured = (np.random.default_rng(7).random(depth.shape) < 0.1) & ~on_ball
    return _as_tensors(image, depth, measured)


def _as_tensors(image: NDArray[np.float64], depth: NDArray[np.float64], mask: object) -> Picture:
    pixels = np.rint(255 * image.clip(0, 1)).astype(np.uint8)
    valid = torch.from_numpy(np.asarray(mask, bool))
    return torch.from_numpy(pixels), torch.from_numpy(depth.astype(np.float32)) * valid, valid


def answers(preset: str) -> dict[str, NDArray[np.float32]]:
    """Depth and, if stated, uncertainty [m] of every picture, thinned by its stride."""
    completer = SteeredCompleter.from_checkpoint(
        "embedded", preset=preset, device="cpu", dtype="float32"
    )
    kept = {}
    for name, stride in STRIDES.items():
        generator = torch.Generator().manual_seed(0)
        completion = completer.complete(*picture(name), generator=generator)
        for kind in ("depth", "uncertainty"):
            values = getattr(completion, kind)
            if values is not None:
                kept[f"{preset}/{name}/{kind}"] = values[0, ::stride, ::stride].numpy()
    return kept


def machine() -> str:
    """What answers to 1e-6 m depend on."""
    lines = Path("/proc/cpuinfo").read_text().splitlines() if Path("/proc/cpuinfo").exists() else []
    model = next((line.split(":")[1].strip() for line in lines if "model name" in line), "")
    capability = torch.backends.cpu.get_cpu_capability()
    parts = {"cpu": model, "isa": capability, "threads": torch.get_num_threads()}
    return json.dumps(parts | {"torch": torch.__version__, "system": platform.system()})


def main() -> None:
    """Writes the file."""
    kept = {key: value for preset in PRESETS for key, value in answers(preset).items()}
    np.savez_compressed(FILE, allow_pickle=False, machine=np.array(machine()), **kept)


if __name__ == "__main__":
    main()
