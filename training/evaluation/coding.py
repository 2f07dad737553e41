"""What is lost between depth and latents, and how edges look afterwards."""

import torch
import torch.nn.functional as F
from matplotlib.figure import Figure
from torch import Tensor

from steered_marigold.io.files import write_figure
from steered_marigold.pictures.colours import robust_range
from steered_marigold.pictures.grids import panels, show, show_depth
from training.evaluation.subject import Findings, Row, Subject, evenly_spaced, mean_row

CROP = 80
FRAMES = 4
PICTURE = "codec.png"


@torch.no_grad()
def coding(subject: Subject) -> Findings:
    """Errors of the true depth through encoder and decoder; a picture of its edges."""
    rows: list[Row] = []
    crops: dict[str, tuple[Tensor, Tensor]] = {}
    drawn = evenly_spaced(subject.frames, FRAMES)
    for frame_id in subject.frames:
        frame = subject.native(frame_id)
        decoded = subject.codec.decode(subject.codec.encode(frame.normalised))
        rows.append(frame.errors(decoded))
        if frame_id in drawn:
            y, x = steepest_window(frame.normalised[0], CROP)
            window = (0, slice(y, y + CROP), slice(x, x + CROP))
            crops[frame_id] = frame.normalised[window], decoded[window]
    write_figure(subject.output / PICTURE, _figure(crops))
    return Findings({"true depth encoded and decoded, 320x240": [mean_row(rows)]}, (PICTURE,))


def steepest_window(depth: Tensor, side: int) -> tuple[int, int]:
    """(row, column) [px] of the square window of a map [height, width] with most edges."""
    edges = torch.zeros_like(depth)
    edges[1:] += (depth[1:] - depth[:-1]).abs()
    edges[:, 1:] += (depth[:, 1:] - depth[:, :-1]).abs()
    sums = F.avg_pool2d(edges.clamp(max=0.2)[None], side, stride=1)[0]
    best = int(sums.argmax())
    return best // sums.shape[1], best % sums.shape[1]


def _figure(crops: dict[str, tuple[Tensor, Tensor]]) -> Figure:
    figure, axes = panels(len(crops), 3, (CROP, CROP))
    for row, (frame_id, (truth, decoded)) in zip(axes, crops.items(), strict=True):
        scale = robust_range(truth.numpy())
        show_depth(row[0], truth.numpy(), scale, f"{frame_id}: truth")
        show_depth(row[1], decoded.numpy(), scale, "decoded")
        limits = {"vmin": -0.2, "vmax": 0.2}
        drawn = show(row[2], (decoded - truth).numpy(), "difference", cmap="RdBu", **limits)
    figure.colorbar(drawn, ax=axes[:, 2].tolist(), label="affine depth, of -1 to 1")
    return figure
