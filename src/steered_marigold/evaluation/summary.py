"""From the results of single images to the figures of a run."""

import csv
import json
import math
import platform
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from importlib.metadata import version
from itertools import product
from pathlib import Path
from typing import Any

import torch

from steered_marigold.core.metrics import UncertaintyErrors, exact_mean
from steered_marigold.evaluation.results import ImageResult
from steered_marigold.evaluation.runner import Run
from steered_marigold.evaluation.statistics import (
    PairedDifference,
    bootstrap_interval,
    paired_comparison,
)
from steered_marigold.io.files import atomic_write

METRICS = ("abs_rel", "delta1", "rmse_m", "mae_m")
"""The paper's columns, in its order."""
UNCERTAINTY_METRICS = tuple(field.name for field in fields(UncertaintyErrors))
TRUST_METRICS = ("wrong_left_out", "right_left_out", "floored_fraction")
"""What became of the measurements, and how much of the answer is a bound."""
KITTI_METRICS = ("irmse_per_km", "imae_per_km")
"""With rmse_mm and mae_mm, the columns of KITTI's own table."""

_IMAGE_COLUMNS = (
    *("frame", "method", "area"),
    *(*METRICS, "delta2", "delta3", "valid_pixels", "seconds"),
    *(*UNCERTAINTY_METRICS, "trusted_fraction", *TRUST_METRICS),
    *("max_deviation_m", "seam_step", *KITTI_METRICS),
)
_COMPARISON_COLUMNS = (
    *("method", "reference", "area", "metric"),
    *("difference", "low", "high", "images", "verdict"),
)

Comparison = dict[tuple[str, str], PairedDifference]


def summarize(run: Run) -> dict[str, Any]:
    """`{"run": settings and machine, "rows": one a method and area}`; see docs/evaluation.md.

    A figure that no image defines, or that is infinite, is None.
    """
    rows = [
        _row(run, method, area)
        for method, area in product(run.results, run.settings.protocol.areas)
    ]
    return {"run": _metadata(run), "rows": rows}


def image_values(run: Run, method: str, area: str, key: str) -> dict[str, float]:
    """A figure of each image that has one, by frame id, in order."""
    values = {}
    for result in run.results[method]:
        value = {**_per_image(result), **result.areas.get(area, {})}.get(key)
        if area in result.areas and value is not None:
            values[result.frame_id] = value
    return values


def reference_method(methods: Iterable[str]) -> str:
    """What the others are compared with: `default`, or the first method."""
    methods = tuple(methods)
    return "default" if "default" in methods else methods[0]


def compare(run: Run, *, area: str) -> Comparison:
    """Each method less the reference, by method and metric, on the images both completed."""
    reference, compared = reference_method(run.results), {}
    for method, key in product(run.results, METRICS):
        first = image_values(run, method, area, key)
        second = image_values(run, reference, area, key)
        if method != reference and first.keys() & second.keys():
            compared[method, key] = paired_comparison(first, second)
    return compared


def verdict(key: str, paired: PairedDifference) -> str:
    """What the difference of a method less the reference says of the reference."""
    if not paired.significant:
        return "not distinguishable"
    return "better" if (paired.difference > 0) == (key != "delta1") else "worse"


def write_summary(summary: Mapping[str, Any], folder: Path) -> None:
    """Writes summary.json."""
    with atomic_write(folder / "summary.json") as path:
        path.write_text(json.dumps(summary, indent=1, allow_nan=False), encoding="utf-8")


def write_images(run: Run, folder: Path) -> None:
    """Writes per_image.csv: a row an image, method and area."""
    rows = [
        {"frame": result.frame_id, "method": method, "area": area, **_per_image(result), **values}
        for method, results in run.results.items()
        for result in results
        for area, values in result.areas.items()
    ]
    _write_csv(folder / "per_image.csv", _IMAGE_COLUMNS, rows)


def write_comparisons(run: Run, compared: Mapping[str, Comparison], folder: Path) -> None:
    """Writes comparisons.csv: a row a method, area and metric. compared: by area."""
    reference = reference_method(run.results)
    rows = [
        {
            "method": method,
            "reference": reference,
            "area": area,
            "metric": key,
            **vars(paired),
            "verdict": verdict(key, paired),
        }
        for area, differences in compared.items()
        for (method, key), paired in differences.items()
    ]
    _write_csv(folder / "comparisons.csv", _COMPARISON_COLUMNS, rows)


def _row(run: Run, method: str, area: str) -> dict[str, Any]:
    results = run.results[method]
    optional = [*UNCERTAINTY_METRICS, "trusted_fraction", *TRUST_METRICS, "seam_step"]
    if run.settings.dataset == "kitti":
        optional += KITTI_METRICS
    values = {
        key: list(image_values(run, method, area, key).values()) for key in (*METRICS, *optional)
    }
    present = {key: x for key, x in values.items() if x or key in METRICS}
    means = {key: _finite(exact_mean(x)) if x else None for key, x in present.items()}
    seconds = [result.seconds for result in results if result.seconds is not None]
    row: dict[str, Any] = {
        "method": method,
        "runs_as": _runs_as(run.described[method]),
        "protocol": run.settings.protocol.name,
        "area": area,
        "images": len(values["abs_rel"]),
        "failed": sum(result.error is not None for result in results),
        **means,
        "seconds_per_image": exact_mean(seconds) if seconds else None,
    }
    if run.settings.dataset == "kitti":
        in_metres = {key: means[f"{key}_m"] for key in ("rmse", "mae")}
        row |= {f"{key}_mm": 1000 * x for key, x in in_metres.items() if x is not None}
    deviations = image_values(run, method, area, "max_deviation_m").values()
    if deviations:
        row["max_deviation_m"] = max(deviations)
    row["interval"] = {
        key: list(bootstrap_interval(present[key]))
        for key, mean in means.items()
        if mean is not None
    }
    return row


def _runs_as(described: Mapping[str, Any]) -> str:
    """E.g. "steers, float32, cpu"."""
    steers = ["steers"] if described["steers"] else []
    return ", ".join([*steers, *(described[k] for k in ("dtype", "device") if k in described)])


def _metadata(run: Run) -> dict[str, Any]:
    settings = run.settings
    return {
        **settings.to_json(),
        "methods": {label: run.described[label] for label in run.results},
        "left_out": run.left_out,
        "workers": run.workers,
        "threads_per_worker": run.threads_per_worker,
        "versions": {name: version(name) for name in ("steered-marigold", "torch", "diffusers")},
        "machine": f"{platform.system()} {platform.machine()}, {_device_name(settings.device)}",
    }


def _device_name(device: str) -> str:
    if device.startswith("cuda"):
        return str(torch.cuda.get_device_name(device))
    return device


def _per_image(result: ImageResult) -> dict[str, float | None]:
    """What does not depend on the area."""
    names = ("seconds", "trusted_fraction", *TRUST_METRICS, "max_deviation_m", "seam_step")
    return {name: getattr(result, name) for name in names}


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _write_csv(path: Path, columns: tuple[str, ...], rows: Sequence[Mapping[str, Any]]) -> None:
    with atomic_write(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns)
        writer.writeheader()
        writer.writerows(rows)
