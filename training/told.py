"""What a U-Net is told in its second pass: measurements around holes, as the pipeline tells them.

See `continuation` in docs/method.md; the pipeline's own functions make it here.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from steered_marigold.core import sparsity
from steered_marigold.core.continuation import LIMIT, known_cells, told_depth
from steered_marigold.core.frame import Frame

# fewer measurements say nothing about units
LEAST_MEASURED = 20


@dataclass(frozen=True)
class Told:
    """All in the units in which it is told, [-1, 1] more or less.

    depth: what is told [height, width]: the first answer, moved to the measurements. target: the
    true depth [height, width]. known: cells [h, w] where measurements are near.
    """

    depth: Tensor
    target: Tensor
    known: Tensor


def draw_measured(depth: Tensor, known: Tensor, generator: torch.Generator) -> Frame:
    """A frame without a picture, measured with holes like those of one of the protocols.

    depth: [m]. known: where there is a truth to measure.
    """
    height, width = depth.shape
    everything = Frame(
        image=torch.zeros(height, width, 3, dtype=torch.uint8),
        sparse_depth=torch.where(known, depth, 0),
        valid_mask=known,
    )

    def between(low: float, high: float) -> float:
        return low + (high - low) * float(torch.rand((), generator=generator))

    kind = int(torch.randint(8, (), generator=generator))
    if kind < 3:  # erased
        top, left = between(0, 0.5), between(0, 0.5)
        rows = slice(round(top * height), round((top + between(0.2, 0.6)) * height))
        columns = slice(round(left * width), round((left + between(0.2, 0.7)) * width))
        return sparsity.erase_rectangle(everything, rows, columns)
    if kind == 3:  # objects
        count = int(between(1, 5))
        return sparsity.remove_blobs(everything, count, generator=generator)
    if kind == 4:  # range
        limit = float(torch.quantile(depth[known][::16], between(0.3, 0.9)))
        return sparsity.limit_range(everything, limit)
    if kind == 5:  # the upper part, as where a LiDAR does not reach
        rows = slice(0, round(between(0.25, 0.7) * height))
        return sparsity.erase_rectangle(everything, rows, slice(0, width))
    if kind == 6:  # lidar
        return sparsity.scan_lines(everything, int(between(8, 64)), generator=generator)
    return sparsity.sample_uniform(everything, int(10 ** between(1.5, 3.5)), generator=generator)


def tell(first: Tensor, depth: Tensor, measured: Frame) -> Told | None:
    """What is told after a first answer; None where too little was measured.

    first: the first answer [height, width], in the model's units. depth: the truth [m].
    """
    if int(measured.valid_mask.sum()) < LEAST_MEASURED:
        return None
    told, trusted = told_depth(first, measured.sparse_depth, measured.valid_mask)
    metres, units = depth[trusted], told[trusted]
    spread = metres - metres.mean()
    slope = (spread * units).sum() / spread.square().sum().clamp(min=1e-6)
    if slope <= 0:
        return None
    target = (units.mean() + slope * (depth - metres.mean())).clamp(-LIMIT, LIMIT)
    return Told(told, target, known_cells(trusted, 8))
