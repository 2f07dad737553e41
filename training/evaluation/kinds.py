"""Errors apart by what is seen: streets, indoors of another sensor, close-ups."""

import tempfile
from pathlib import Path

import cv2
import numpy as np

from steered_marigold.errors import InputError
from steered_marigold.evaluation.protocols import Protocol
from steered_marigold.evaluation.runner import Evaluator
from training.evaluation.comparison import means, score
from training.evaluation.sheet import draw_sheets
from training.evaluation.subject import Findings, Row, Subject, evenly_spaced
from training.rgbd import KINDS, held_out_pairs

METHODS = ("linear", "colorization", "marigold", "default")
PROTOCOLS = {
    "streets": ("lidar-64", "lidar-16", "upper-half"),
    "indoors": ("objects", "region", "upper-half"),
    "close-ups": ("objects", "region", "upper-half"),
}
KEYS = ("abs_rel", "delta1", "rmse_m")
SHOWN = 12


def kinds(subject: Subject) -> Findings:
    """By kind and protocol, the hidden part of each frame; unsteered the whole frame; sheets.

    Raises InputError without a folder of RGB-D pairs.
    """
    if subject.rgbd is None:
        raise InputError("the part kinds needs --rgbd, a folder of RGB-D pairs")
    hidden: list[Row] = []
    unsteered: list[Row] = []
    pictures: list[str] = []
    with tempfile.TemporaryDirectory() as temporary:
        masks = _upper_half(Path(temporary))
        for kind in KINDS:
            names = evenly_spaced(held_out_pairs(subject.split, kind), subject.limit)
            folder = _as_folder(subject.rgbd, names, Path(temporary) / kind)
            frames = tuple(sorted(_frame_id(name) for name in names))
            for protocol in PROTOCOLS[kind]:
                run = subject.run_on(folder, _protocol(protocol, masks), METHODS, frames)
                rows = score(run, "hidden")
                hidden += [
                    {
                        "kind": kind,
                        "protocol": protocol,
                        "method": label,
                        **means(rows[label], KEYS),
                    }
                    for label in METHODS
                ]
            whole = subject.run_on(folder, _protocol("region", masks), ("marigold",), frames)
            row = means(score(whole, "full")["marigold"], KEYS)
            unsteered.append({"kind": kind, "frames": len(frames), **row})
            drawn = Evaluator(subject.run_on(folder, _protocol("upper-half", masks), (), frames))
            shown = [drawn.prepare(frame) for frame in evenly_spaced(frames, SHOWN)]
            pictures += draw_sheets(shown, subject, f"sheet_{kind}")
    tables = {"what is hidden": hidden, "unsteered, the whole frame": unsteered}
    return Findings(tables, tuple(pictures))


def _protocol(name: str, masks: Path) -> Protocol:
    if name == "upper-half":
        return Protocol(kind="sensor", masks=masks)
    kind, _, lines = name.partition("-")
    return Protocol(kind=kind, lines=int(lines) if lines else None)


def _upper_half(folder: Path) -> Path:
    """A folder with a depth map that has nothing in its upper half."""
    masks = folder / "masks"
    masks.mkdir()
    depth = np.zeros((240, 320), np.uint16)
    depth[120:] = 1000
    cv2.imwrite(str(masks / "depth.png"), depth)
    return masks


def _frame_id(name: str) -> str:
    return name.replace("/", "_")


def _as_folder(rgbd: Path, names: tuple[str, ...], folder: Path) -> Path:
    """Links to the pairs, as a folder that the evaluation reads."""
    for part, suffix in (("rgb", "jpg"), ("depth", "png")):
        (folder / part).mkdir(parents=True)
        for name in names:
            source = (rgbd / f"{name}.{suffix}").absolute()
            (folder / part / f"{_frame_id(name)}.{suffix}").symlink_to(source)
    return folder
