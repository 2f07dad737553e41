"""Whether memory makes a stream better: depth is hidden, and completed frame by frame and not.

    python -m benchmarks.streams --sequence ../shared/data/sequence --frames 40
    python -m benchmarks.streams --room 900000 --holes sensor --frames 40

A sequence's folder holds rgb/NNNN.jpg, depth/NNNN.png (mm) and pose/NNNN.txt (camera to world),
its K is the one below; what the camera measured where depth was hidden is the truth. A room is
rendered, and its truth is exact; the checkpoint was trained on others of this generator, so that
only the comparison counts.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import mean, median
from time import process_time
from typing import Annotated

import numpy as np
import torch
import typer
from torch import Tensor

from benchmarks.measuring import machine, markdown_table, write_json
from rooms.render import camera_path
from rooms.sensor import sensor_holes
from steered_marigold.core.completion import DepthCompletion
from steered_marigold.core.frame import Frame
from steered_marigold.core.geometry import unproject
from steered_marigold.core.memory import StreamMemory, Warp
from steered_marigold.core.warping import warp_by_flow, warp_depth
from steered_marigold.io.depth_maps import read_depth
from steered_marigold.io.images import read_image
from steered_marigold.io.odometry import find_warp, image_flow
from steered_marigold.methods.steered import SteeredCompleter
from steered_marigold.methods.streaming import StreamingCompleter

SEQUENCE_K = torch.tensor([[262.5, 0.0, 160.0], [0.0, 262.5, 120.0], [0.0, 0.0, 1.0]])
# points whose depth, moved from one frame to the next, differs less are the same and stand still
STILL = 0.03


@dataclass(frozen=True)
class View:
    """A frame with all that is known of its depth, and the camera's place in the world.

    seen: where a real sensor would have measured.
    """

    frame: Frame
    pose: Tensor
    seen: Tensor

    @property
    def K(self) -> Tensor:  # noqa: N802
        """[px]."""
        assert self.frame.K is not None
        return self.frame.K

    def motion_to(self, later: "View") -> Tensor:
        """Points of this camera's frame to the later one's."""
        motion: Tensor = torch.linalg.inv(later.pose) @ self.pose
        return motion.float()


def read_views(folder: Path, first: int, count: int) -> list[View]:
    """So many frames of a sequence."""
    views = []
    for i in range(first, first + count):
        measured = read_depth(folder / "depth" / f"{i:04}.png")
        frame = Frame(
            image=read_image(folder / "rgb" / f"{i:04}.jpg").pixels,
            sparse_depth=measured.depth,
            valid_mask=measured.valid_mask,
            K=SEQUENCE_K,
        )
        pose = torch.from_numpy(np.loadtxt(folder / "pose" / f"{i:04}.txt"))
        views.append(View(frame, pose, measured.valid_mask))
    return views


def render_views(seed: int, count: int) -> list[View]:
    """So many frames of a hand-held camera in a rendered room."""
    views = []
    for room in camera_path(seed, count):
        depth = torch.from_numpy(room.depth)
        frame = Frame(
            image=torch.from_numpy(room.image),
            sparse_depth=depth,
            valid_mask=torch.ones_like(depth, dtype=torch.bool),
            K=torch.from_numpy(room.K).float(),
        )
        seen = torch.from_numpy(sensor_holes(room, np.random.default_rng(seed)))
        views.append(View(frame, torch.from_numpy(room.camera_to_world).double(), seen))
    return views


def sensor(views: list[View]) -> Iterator[Tensor]:
    """What a real sensor would not have measured; nothing in a real sequence."""
    for view in views:
        yield ~view.seen


def blobs(views: list[View]) -> Iterator[Tensor]:
    """Five ellipses anywhere in each frame: a sensor whose holes come and go."""
    random = np.random.default_rng(1)
    for view in views:
        height, width = view.frame.size
        y, x = np.mgrid[:height, :width]
        hidden = np.zeros((height, width), bool)
        for _ in range(5):
            row, column = random.integers(height), random.integers(width)
            a, b = random.integers(15, 50, 2)
            hidden |= ((y - row) / a) ** 2 + ((x - column) / b) ** 2 < 1
        yield torch.from_numpy(hidden)


def window(views: list[View]) -> Iterator[Tensor]:
    """The same rectangle of every frame, so that the camera moves it over the scene."""
    for view in views:
        hidden = torch.zeros(view.frame.size, dtype=torch.bool)
        hidden[70:170, 100:220] = True
        yield hidden


def dropped(views: list[View]) -> Iterator[Tensor]:
    """All but one in a hundred measurements of two frames in three."""
    random = np.random.default_rng(1)
    for i, view in enumerate(views):
        share = 0.01 if i % 3 else 1.0
        yield torch.from_numpy(random.random(view.frame.size) >= share)


def surface(views: list[View]) -> Iterator[Tensor]:
    """Four balls of 25 cm in the world, which are never measured: glass, or a dark thing."""
    middle = views[len(views) // 2]
    places = _in_world(middle)[middle.frame.valid_mask]
    centres = places[np.random.default_rng(1).integers(len(places), size=4)]
    for view in views:
        distance = torch.cdist(_in_world(view).flatten(0, 1), centres).amin(dim=1)
        yield (distance < 0.25).reshape(view.frame.size)


def _in_world(view: View) -> Tensor:
    points = unproject(view.frame.sparse_depth, view.K).double()
    return points @ view.pose[:3, :3].T + view.pose[:3, 3]


HOLES: dict[str, Callable[[list[View]], Iterator[Tensor]]] = {
    "blobs": blobs,
    "window": window,
    "dropped": dropped,
    "surface": surface,
    "sensor": sensor,
}
FindWarp = Callable[[Frame, Frame, Tensor], Warp | None]
ToWarp: dict[str, FindWarp] = {
    "poses": lambda earlier, present, motion: _found_warp(earlier, present, motion),
    "estimated": lambda earlier, present, motion: _found_warp(earlier, present, None),
    "flow": lambda earlier, present, motion: _flow_warp(earlier, present),
}


def _found_warp(earlier: Frame, present: Frame, motion: Tensor | None) -> Warp | None:
    found = find_warp(earlier, present, motion=motion)
    return None if found is None else found.warp


def _flow_warp(earlier: Frame, present: Frame) -> Warp:
    flow = image_flow(earlier.image, present.image)
    return lambda depth, mask: warp_by_flow(depth, mask, flow)


def answers(way: str, views: list[View], hidden: list[Tensor]) -> Iterator[DepthCompletion]:
    """The answers to a stream, by one of `WAYS`."""
    alone = SteeredCompleter.from_checkpoint(preset="fast", device="cpu")
    frames = [view.frame.keep(~mask) for view, mask in zip(views, hidden, strict=True)]
    if way == "frame by frame":
        yield from map(alone.answer, frames)
        return
    if way.startswith("stream"):
        if way == "stream, poses":
            frames = [replace(f, pose=v.pose) for f, v in zip(frames, views, strict=True)]
        yield from map(StreamingCompleter(alone).answer, frames)
        return
    memory = StreamMemory()
    for i, frame in enumerate(frames):
        motion = views[i - 1].motion_to(views[i]) if i else torch.eye(4)
        to_warp = ToWarp[way.removeprefix("measurements alone, ")]
        warp = to_warp(frames[i - 1], frame, motion) if i else None
        yield alone.answer(memory.recall(frame, warp).frame)


# "measurements alone": the last answers are not remembered
WAYS = (
    "frame by frame",
    "stream",
    "stream, poses",
    *(f"measurements alone, {source}" for source in ToWarp),
)


def timed(found: Iterator[DepthCompletion]) -> tuple[list[Tensor], float]:
    """The depths, and the CPU time of all threads that a frame takes [s], the median."""
    depths, seconds = [], []
    started = process_time()
    for answer in found:
        seconds.append(process_time() - started)
        depths.append(answer.depth[0])
        started = process_time()
    return depths, median(seconds)


def scores(views: list[View], hidden: list[Tensor], depths: list[Tensor]) -> tuple[float, float]:
    """(error, flicker) where depth was hidden.

    error: mean |answer - truth| / truth. flicker: mean change of log(answer / truth) from one
    frame to the next at points that were hidden in both and stand still.
    """
    errors, changes = [], []
    logs = []
    for i, (view, mask, depth) in enumerate(zip(views, hidden, depths, strict=True)):
        truth, known = view.frame.sparse_depth, view.frame.valid_mask
        safe = torch.where(known, truth, depth)
        logs.append((depth / safe).log())
        judged = mask & known
        if judged.any():
            errors.append(float(((depth - safe).abs() / safe)[judged].mean()))
        if i:
            before = views[i - 1].frame
            moved = warp_depth(
                before.sparse_depth, before.valid_mask, view.K, views[i - 1].motion_to(view)
            )
            still = (moved.depth.clamp(min=1e-3) / safe).log().abs() < STILL
            both = judged & moved.valid_mask & still & (moved.carry(hidden[i - 1].float()) > 0)
            if both.any():
                changes.append(float((logs[i] - moved.carry(logs[i - 1]))[both].abs().mean()))
    return mean(errors), mean(changes) if changes else 0.0


def main(
    sequence: Annotated[Path | None, typer.Option(help="Folder of a sequence.")] = None,
    room: Annotated[int | None, typer.Option(help="Seed of a rendered room.")] = None,
    frames: Annotated[int, typer.Option(help="Consecutive frames.")] = 40,
    first: Annotated[int, typer.Option(help="The first of them.")] = 0,
    holes: Annotated[str, typer.Option(help="Kinds, by comma.")] = "blobs,window,dropped,surface",
    ways: Annotated[str, typer.Option(help="Ways, by semicolon.")] = ";".join(WAYS),
    threads: Annotated[int, typer.Option()] = 2,
    output: Annotated[Path, typer.Option(help="Folder of the JSON file.")] = Path("runs/bench"),
) -> None:
    """Error and flicker in the holes of each way through the same frames."""
    torch.set_num_threads(threads)
    if (sequence is None) == (room is None):
        raise typer.BadParameter("name either a sequence or a room")
    views = read_views(sequence, first, frames) if sequence else render_views(room or 0, frames)
    rows: dict[str, dict[str, tuple[float, float, float]]] = {}
    for kind in holes.split(","):
        hidden = list(HOLES[kind](views))
        for way in ways.split(";"):
            depths, seconds = timed(answers(way, views, hidden))
            rows.setdefault(kind, {})[way] = (*scores(views, hidden, depths), seconds)
        print(f"\n{kind}: {frames} frames, 320x240, from {first if sequence else room} on\n")
        cells = [(way, f"{e:.4f}", f"{c:.4f}", f"{s:.3f}") for way, (e, c, s) in rows[kind].items()]
        header = ("", "error in holes", "flicker", "CPU s a frame")
        print(markdown_table(header, cells), flush=True)
    record = {"machine": machine(), "frames": frames, "first": first, "room": room, "rows": rows}
    write_json(output / "streams.json", record)


if __name__ == "__main__":
    typer.run(main)
