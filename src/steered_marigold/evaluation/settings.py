"""What a run is: everything that its figures depend on."""

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from steered_marigold.datasets.dataset import Dataset
from steered_marigold.datasets.registry import open_dataset
from steered_marigold.evaluation.protocols import Protocol
from steered_marigold.io.files import atomic_write, decoding, require_file
from steered_marigold.methods.completer import DepthCompleter

MethodFactory = Callable[[str], DepthCompleter]


@dataclass(frozen=True, kw_only=True)
class RunSettings:
    """A run of methods on the frames of a data set under one protocol.

    dataset, path, split, ground_truth, depth_scale, max_depth: see `open_dataset`.
    methods: names for `create_method`, in the order of the tables. frames: frame ids, sorted.
    official_metrics: the authors' delta, see `depth_errors`.
    checkpoint, device, dtype, weights: see `create_method`; dtype by its name, of all methods.
    """

    dataset: str
    path: Path
    split: str = "test"
    ground_truth: str = "raw"
    depth_scale: float | None = None
    max_depth: float | None = None
    protocol: Protocol
    methods: tuple[str, ...]
    frames: tuple[str, ...]
    seed: int = 0
    official_metrics: bool = False
    checkpoint: str = "embedded"
    device: str = "cpu"
    dtype: str = "float32"
    weights: Mapping[str, Path] = field(default_factory=dict)

    def open_dataset(self) -> Dataset:
        """The data set. Raises what `open_dataset` raises."""
        return open_dataset(
            self.dataset,
            self.path,
            split=self.split,
            ground_truth=self.ground_truth,
            depth_scale=self.depth_scale,
            max_depth=self.max_depth,
        )

    def method_factory(self) -> MethodFactory:
        """Creates the methods by name."""
        from steered_marigold.methods.registry import create_method

        return partial(
            create_method,
            checkpoint=self.checkpoint,
            device=self.device,
            dtype=self.dtype,
            weights=self.weights,
        )

    def to_json(self) -> dict[str, Any]:
        """As values that JSON holds."""
        return dict(json.loads(json.dumps(asdict(self), default=str)))

    def save(self, folder: Path) -> None:
        """Writes run.json, from which `load` reads the same settings."""
        with atomic_write(folder / "run.json") as temporary:
            temporary.write_text(json.dumps(self.to_json(), indent=1), encoding="utf-8")

    @classmethod
    def load(cls, folder: Path) -> "RunSettings":
        """The settings of the run in a folder. Raises FileFormatError if there is none."""
        path = require_file(folder / "run.json")
        with decoding(path):
            values = json.loads(path.read_text(encoding="utf-8"))
            protocol = dict(values["protocol"])
            protocol["masks"] = protocol["masks"] and Path(protocol["masks"])
            values |= {
                "path": Path(values["path"]),
                "protocol": Protocol(**protocol),
                "methods": tuple(values["methods"]),
                "frames": tuple(values["frames"]),
                "weights": {name: Path(file) for name, file in values["weights"].items()},
            }
            return cls(**values)
