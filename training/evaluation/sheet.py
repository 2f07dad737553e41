"""Contact sheets: image, input, unsteered, the default preset, and its error where it is known."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby
from pathlib import Path

import numpy as np
import torch
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from steered_marigold.datasets.folder import FrameFolder
from steered_marigold.evaluation.pictures import sparse_picture, truth_picture
from steered_marigold.evaluation.protocols import (
    PreparedFrame,
    Protocol,
    frame_generator,
    prepare,
)
from steered_marigold.io.files import write_figure
from steered_marigold.methods.completer import DepthCompleter
from steered_marigold.methods.registry import create_method
from steered_marigold.pictures.colours import robust_range
from steered_marigold.pictures.grids import panels, show, show_depth
from training.evaluation.subject import SEED, Findings, Subject, evenly_spaced

METHODS = {"unsteered": "marigold", "default": "default"}
FRAMES, ROWS = 24, 8
# metres per unit, by how a frame's name begins; other files have millimetres, or float metres
DEPTH_SCALES = {"kitti_vis": 1 / 256}


def sheet(subject: Subject) -> Findings:
    """Sheets of the frames with the centre erased, and of real sensor frames."""
    chosen = evenly_spaced(subject.frames, FRAMES)
    rooms = [subject.prepared("paper-erased", frame_id) for frame_id in chosen]
    pictures = draw_sheets(rooms, subject, "sheet")
    if subject.real_frames is not None:
        folder = subject.real_frames
        real = [read_real_frame(folder, name) for name in FrameFolder(folder).frame_ids]
        pictures += draw_sheets(real, subject, "sheet_real")
    return Findings({}, tuple(pictures))


def read_real_frame(folder: Path, frame_id: str) -> PreparedFrame:
    """A sensor frame with all that it measured, and no truth to score."""
    scales = [scale for name, scale in DEPTH_SCALES.items() if frame_id.startswith(name)]
    sample = FrameFolder(folder, depth_scale=scales[0] if scales else None).load(frame_id)
    nothing = torch.zeros_like(sample.metric_mask)
    given = replace(sample, frame=sample.truth, metric_mask=nothing)
    return prepare(given, Protocol(kind="given"), seed=SEED)


def draw_sheets(frames: list[PreparedFrame], subject: Subject, title: str) -> list[str]:
    """Writes `title`_1.png, `title`_2.png, ... of up to ROWS frames, and returns their names.

    Frames of very different shapes are not on one sheet.
    """
    methods = {
        label: create_method(name, checkpoint=subject.checkpoint) for label, name in METHODS.items()
    }
    names: list[str] = []
    for _, alike in groupby(sorted(frames, key=elongation), key=elongation):
        group = list(alike)
        for first in range(0, len(group), ROWS):
            name = f"{title}_{len(names) + 1}.png"
            write_figure(subject.output / name, _draw(group[first : first + ROWS], methods))
            names.append(name)
    return names


def elongation(frame: PreparedFrame) -> int:
    """How many times wider than high a frame is, rounded."""
    height, width = frame.shown.size
    return round(width / height)


def _draw(frames: Sequence[PreparedFrame], methods: dict[str, DepthCompleter]) -> Figure:
    """A row a frame; depths of a row share one scale, errors go from 0 to a quarter of its median.

    Where there is no truth the scale is that of the default preset's answer.
    """
    columns = 2 + len(methods) + has_truth(frames[0])
    figure, axes = panels(len(frames), columns, frames[0].shown.size)
    for row, frame in zip(axes, frames, strict=True):
        answers = {title: _complete(method, frame) for title, method in methods.items()}
        truth = truth_picture(frame) if has_truth(frame) else None
        reference = answers["default"] if truth is None else truth
        scale = robust_range(reference)
        show(row[0], frame.shown.image.numpy(), frame.shown.id)
        show_depth(row[1], sparse_picture(frame), scale, f"{scale.vmin:.2g} to {scale.vmax:.2g} m")
        for cell, (title, depth) in zip(row[2:], answers.items(), strict=False):
            show_depth(cell, depth, scale, title)
        if truth is not None:
            limits = Normalize(0, max(0.1, 0.25 * float(np.nanmedian(truth))))
            error = np.abs(answers["default"] - truth)
            show(row[-1], error, f"error, to {limits.vmax:.2g} m", cmap="magma", norm=limits)
    return figure


def has_truth(frame: PreparedFrame) -> bool:
    """Whether there is anything to score."""
    return any(bool(mask.any()) for mask in frame.areas.values())


def _complete(method: DepthCompleter, frame: PreparedFrame) -> NDArray[np.float32]:
    generator = frame_generator(SEED, frame.shown.id, "method")
    answer = method.answer(frame.shown, generator=generator)
    depth: NDArray[np.float32] = answer.depth[0].numpy()
    return depth
