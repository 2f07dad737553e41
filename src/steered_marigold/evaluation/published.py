"""The rows of the paper's Tables I and II and of Prior-Depth-Anything, as printed.

Gregorek and Nalpantidis, SteeredMarigold. NYUv2, 654 test frames, raw depth, 608x448. Samples are
as printed: 13620 stands for 5 %.

Wang et al., Prior-Depth-Anything (v1.1, REL alone): NYUv2, depth missing beyond 3 m, in a square,
or in segmented objects, for which our `objects` has ellipses.
"""

from dataclasses import dataclass

from steered_marigold.evaluation.settings import RunSettings


@dataclass(frozen=True)
class PublishedRow:
    """method and area as printed; points: samples given, before any are erased, if printed."""

    method: str
    points: int | None
    area: str
    abs_rel: float
    delta1: float | None = None
    rmse_m: float | None = None
    mae_m: float | None = None

    @property
    def title(self) -> str:
        """The method, and the samples it was given."""
        return self.method if self.points is None else f"{self.method}, {self.points} samples"


UNIFORM = (
    PublishedRow("BP-Net", 500, "608x448", 0.0619, 0.9228, 0.3019, 0.1562),
    PublishedRow("BP-Net", 2000, "608x448", 0.0114, 0.9911, 0.1182, 0.0308),
    PublishedRow("BP-Net", 13620, "608x448", 0.0066, 0.9955, 0.0862, 0.0190),
    PublishedRow("CompletionFormer", 500, "608x448", 0.0452, 0.9550, 0.2570, 0.1297),
    PublishedRow("CompletionFormer", 2000, "608x448", 0.0072, 0.9974, 0.0725, 0.0234),
    PublishedRow("CompletionFormer", 13620, "608x448", 0.0043, 0.9988, 0.0506, 0.0147),
    PublishedRow("Marigold", 13620, "608x448", 0.0615, 0.9548, 0.2478, 0.1555),
    PublishedRow("SteeredMarigold 0.1", 13620, "608x448", 0.0196, 0.9965, 0.0969, 0.0524),
    PublishedRow("SteeredMarigold 0.2", 13620, "608x448", 0.0144, 0.9979, 0.0777, 0.0392),
    PublishedRow("SteeredMarigold 0.3", 13620, "608x448", 0.0124, 0.9982, 0.0714, 0.0342),
    PublishedRow("SteeredMarigold 0.4", 13620, "608x448", 0.0114, 0.9983, 0.0687, 0.0317),
)

ERASED = (
    PublishedRow("BP-Net", 500, "608x448", 0.1875, 0.5969, 0.8575, 0.5590),
    PublishedRow("BP-Net", 2000, "608x448", 0.1467, 0.6644, 0.8068, 0.4547),
    PublishedRow("BP-Net", 13620, "608x448", 0.1358, 0.6788, 0.7700, 0.4222),
    PublishedRow("BP-Net", 500, "408x248", 0.3574, 0.1374, 1.2973, 1.1343),
    PublishedRow("BP-Net", 2000, "408x248", 0.3542, 0.1440, 1.2770, 1.1135),
    PublishedRow("BP-Net", 13620, "408x248", 0.3426, 0.1627, 1.2335, 1.0728),
    PublishedRow("BP-Net", 500, "358x198", 0.3817, 0.1413, 1.3950, 1.2341),
    PublishedRow("BP-Net", 2000, "358x198", 0.3874, 0.1238, 1.3966, 1.2427),
    PublishedRow("BP-Net", 13620, "358x198", 0.3790, 0.1234, 1.3602, 1.2140),
    PublishedRow("CompletionFormer", 500, "608x448", 0.1621, 0.6575, 0.7879, 0.5115),
    PublishedRow("CompletionFormer", 2000, "608x448", 0.1095, 0.7638, 0.6496, 0.3541),
    PublishedRow("CompletionFormer", 13620, "608x448", 0.0987, 0.7857, 0.6107, 0.3200),
    PublishedRow("CompletionFormer", 500, "408x248", 0.2770, 0.3793, 1.1325, 0.9365),
    PublishedRow("CompletionFormer", 2000, "408x248", 0.2502, 0.4409, 1.0027, 0.8167),
    PublishedRow("CompletionFormer", 13620, "408x248", 0.2311, 0.4877, 0.9472, 0.7546),
    PublishedRow("CompletionFormer", 500, "358x198", 0.2965, 0.3658, 1.2151, 1.0247),
    PublishedRow("CompletionFormer", 2000, "358x198", 0.2691, 0.4299, 1.0799, 0.9023),
    PublishedRow("CompletionFormer", 13620, "358x198", 0.2575, 0.4511, 1.0284, 0.8563),
    PublishedRow("Marigold", 13620, "608x448", 0.0618, 0.9559, 0.2555, 0.1599),
    PublishedRow("Marigold", 13620, "408x248", 0.0610, 0.9570, 0.2794, 0.1799),
    PublishedRow("Marigold", 13620, "358x198", 0.0630, 0.9536, 0.2906, 0.1912),
    PublishedRow("SteeredMarigold 0.1", 13620, "608x448", 0.0352, 0.9834, 0.1854, 0.0960),
    PublishedRow("SteeredMarigold 0.1", 13620, "408x248", 0.0510, 0.9718, 0.2586, 0.1523),
    PublishedRow("SteeredMarigold 0.1", 13620, "358x198", 0.0573, 0.9646, 0.2850, 0.1743),
)

MISSING_AREAS = {
    "range": (
        PublishedRow("Prior-Depth-Anything", None, "hidden", 0.190),
        PublishedRow("Marigold-DC", None, "hidden", 0.198),
        PublishedRow("Depth Pro, of the image alone", None, "hidden", 0.109),
    ),
    "shape": (
        PublishedRow("Prior-Depth-Anything", None, "hidden", 0.0197),
        PublishedRow("Marigold-DC", None, "hidden", 0.0237),
    ),
    "objects": (
        PublishedRow("Prior-Depth-Anything", None, "hidden", 0.0514),
        PublishedRow("Marigold-DC", None, "hidden", 0.0618),
    ),
}
TABLES = {"paper-uniform": UNIFORM, "paper-erased": ERASED, **MISSING_AREAS}


def published_rows(settings: RunSettings, area: str) -> tuple[PublishedRow, ...]:
    """The published rows that a run compares with: their data, truth and protocols."""
    if (settings.dataset, settings.split, settings.ground_truth) != ("nyuv2", "test", "raw"):
        return ()
    table = TABLES.get(settings.protocol.kind, ())
    return tuple(row for row in table if row.area == area)
