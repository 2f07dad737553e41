"""Time and memory of the learned baselines on this machine's CPU, as a Markdown table.

    python -m benchmarks.baselines --size 608x448 --threads 2

Weights are random, which changes neither time nor memory, and 5 % of the pixels are measured. Each
method runs in a process of its own: two warm-up frames, then the timed ones. Memory is the largest
resident set of that process, the libraries included.
"""

import argparse
import os
import platform
import resource
import statistics
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import torch
from torch import nn

from steered_marigold.methods.bpnet import BPNet, BPNetCompleter
from steered_marigold.methods.completer import DepthCompleter
from steered_marigold.methods.completionformer import CompletionFormer, CompletionFormerCompleter

METHODS: dict[str, tuple[type[nn.Module], type[BPNetCompleter | CompletionFormerCompleter]]] = {
    "bpnet": (BPNet, BPNetCompleter),
    "completionformer": (CompletionFormer, CompletionFormerCompleter),
}
WARM_UP = 2


@dataclass(frozen=True)
class Measurement:
    """seconds: of each timed frame. peak_mib: largest resident set [MiB]."""

    seconds: list[float]
    peak_mib: float


def measure(
    method: str, weights: Path, *, width: int, height: int, frames: int, threads: int
) -> Measurement:
    """Completes the same random frame again and again."""
    torch.set_num_threads(threads)
    generator = torch.Generator().manual_seed(0)
    image = torch.randint(256, (height, width, 3), dtype=torch.uint8, generator=generator)
    valid_mask = torch.rand(height, width, generator=generator) < 0.05
    sparse_depth = 1 + 4 * torch.rand(height, width, generator=generator)
    K = torch.tensor([[width, 0, width / 2], [0, width, height / 2], [0, 0, 1.0]])
    completer: DepthCompleter = METHODS[method][1](weights)
    seconds = []
    for _ in range(WARM_UP + frames):
        start = time.perf_counter()
        completer.complete(image, sparse_depth, valid_mask, K)
        seconds.append(time.perf_counter() - start)
    peak_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return Measurement(seconds[WARM_UP:], peak_kib / 1024)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", default="608x448", help="width x height [px]")
    parser.add_argument("--frames", type=int, default=5, help="timed frames of each method")
    parser.add_argument("--threads", type=int, default=2)
    arguments = parser.parse_args()
    width, height = map(int, arguments.size.split("x"))

    print(
        f"{arguments.size}, 5 % measured, seed 0, {WARM_UP} warm-up and {arguments.frames} timed "
        f"frames, {arguments.threads} threads of {os.cpu_count()} cores, {platform.machine()}, "
        f"torch {torch.__version__}\n"
    )
    print("| method | parameters | median s | fastest s | slowest s | peak memory MiB |")
    print("|---|---|---|---|---|---|")
    for method, (network_type, _) in METHODS.items():
        with tempfile.TemporaryDirectory() as folder:
            weights = Path(folder) / "random.pth"
            network = network_type()
            torch.save(network.state_dict(), weights)
            with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
                measurement = pool.submit(
                    measure,
                    method,
                    weights,
                    width=width,
                    height=height,
                    frames=arguments.frames,
                    threads=arguments.threads,
                ).result()
        parameters = sum(parameter.numel() for parameter in network.parameters())
        seconds = measurement.seconds
        print(
            f"| {method} | {parameters / 1e6:.1f} M | {statistics.median(seconds):.2f} | "
            f"{min(seconds):.2f} | {max(seconds):.2f} | {measurement.peak_mib:.0f} |"
        )


if __name__ == "__main__":
    main()
