"""Time and memory of the learned baselines on this machine's CPU.

    python -m benchmarks.baselines --size 608x448 --threads 2

Weights are random, which changes neither time nor memory, and 5 % of the pixels are measured.
"""

import tempfile
from functools import partial
from pathlib import Path
from typing import Annotated

import torch
import typer
from torch import nn

from benchmarks.measuring import (
    Force,
    describe,
    idle_machine,
    markdown_table,
    measure_interleaved,
    ratio_cell,
    write_json,
)
from benchmarks.subjects import PAPER_FRACTION, sample_frame
from steered_marigold.methods.bpnet import BPNet, BPNetCompleter
from steered_marigold.methods.completionformer import CompletionFormer, CompletionFormerCompleter

METHODS: dict[str, tuple[type[nn.Module], type[BPNetCompleter | CompletionFormerCompleter]]] = {
    "bpnet": (BPNet, BPNetCompleter),
    "completionformer": (CompletionFormer, CompletionFormerCompleter),
}


def main(
    size: Annotated[str, typer.Option(help="Width x height in pixels.")] = "608x448",
    repeats: Annotated[int, typer.Option(min=1, help="Timed frames of each method.")] = 5,
    threads: Annotated[int, typer.Option(min=1)] = 2,
    output: Annotated[Path, typer.Option(help="Folder of the JSON file.")] = Path("runs/bench"),
    force: Force = False,
) -> None:
    """BP-Net and CompletionFormer on one frame, in turn."""
    record = idle_machine(threads, force=force)
    torch.set_num_threads(threads)
    width, height = map(int, size.split("x"))
    frame = sample_frame(width, height, round(PAPER_FRACTION * width * height))
    K = torch.tensor([[width, 0, width / 2], [0, width, height / 2], [0, 0, 1.0]])
    parameters, works = {}, {}
    for name, (network_type, completer_type) in METHODS.items():
        network = network_type()
        parameters[name] = sum(parameter.numel() for parameter in network.parameters())
        completer = with_weights(completer_type, network)
        works[name] = partial(completer.complete, frame.image, frame.sparse_depth, frame.mask, K)
    timings = measure_interleaved(works, warm_up=2, repeats=repeats)
    rows = [
        (name, f"{parameters[name] / 1e6:.1f} M", *t.cells, ratio_cell(t, timings["bpnet"]))
        for name, t in timings.items()
    ]
    header = ("method", "parameters", "median s", "spread s", "memory MiB", "times faster")
    print(f"{size}, {int(frame.mask.sum())} measurements, {repeats} repeats; {describe(record)}\n")
    print(markdown_table(header, rows))
    settings = {"size": size, "warm_up": 2, "repeats": repeats, "seed": 0}
    content = {"machine": record, "settings": settings, "methods": timings}
    write_json(output / "baselines.json", content)


def with_weights(
    completer_type: type[BPNetCompleter | CompletionFormerCompleter], network: nn.Module
) -> BPNetCompleter | CompletionFormerCompleter:
    """The completer, with a network's random weights in place of its authors'."""
    with tempfile.TemporaryDirectory() as folder:
        weights = Path(folder) / "random.pth"
        torch.save(network.state_dict(), weights)
        return completer_type(weights)


if __name__ == "__main__":
    typer.run(main)
