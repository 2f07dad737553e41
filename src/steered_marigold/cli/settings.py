"""What a run of `complete` was asked for, checked before any work."""

from dataclasses import dataclass, replace
from pathlib import Path

from jaxtyping import Float
from torch import Tensor

from steered_marigold.errors import InputError
from steered_marigold.io.depth_maps import WRITABLE_DEPTH_SUFFIXES
from steered_marigold.io.files import require_suffix


@dataclass(frozen=True, kw_only=True)
class Inputs:
    """The files of a frame; for a folder run, the folders. depth: None if nothing was measured."""

    image: Path
    depth: Path | None = None
    confidence: Path | None = None

    def given(self) -> list[Path]:
        """The paths that are not None."""
        return [path for path in (self.image, self.depth, self.confidence) if path is not None]


@dataclass(frozen=True, kw_only=True)
class Outputs:
    """What to write, None = not asked for; for a folder run, the folders."""

    depth: Path
    uncertainty: Path | None = None
    visualization: Path | None = None
    point_cloud: Path | None = None

    def asked(self) -> dict[str, Path]:
        """The paths that are not None, by name."""
        return {name: path for name, path in vars(self).items() if path is not None}

    def of_frame(self, stem: str, depth_suffix: str) -> "Outputs":
        """The files of the frame `stem` in these folders."""
        suffixes = {"visualization": ".png", "point_cloud": ".ply"}
        files = {
            name: folder / f"{stem}{suffixes.get(name, depth_suffix)}"
            for name, folder in self.asked().items()
        }
        return replace(self, **files)

    def require_distinct(self, inputs: Inputs) -> None:
        """InputError if an output would overwrite another one or an input."""
        taken = {path.resolve() for path in inputs.given()}
        for path in self.asked().values():
            if path.resolve() in taken:
                raise InputError(f"{path}: is named twice, or is an input; choose another output")
            taken.add(path.resolve())


@dataclass(frozen=True, kw_only=True)
class Settings:
    """How every frame of a run is read, completed and written; see `complete --help`."""

    seed: int = 0
    depth_scale: float | None = None
    max_depth: float | None = None
    registered: bool = False
    K: Float[Tensor, "3 3"] | None = None
    no_measurements: bool = False
    max_uncertainty: float | None = None
    output_scale: float | None = None


def require_consistent(inputs: Inputs, outputs: Outputs, settings: Settings) -> None:
    """InputError unless the arguments agree with each other; looks at no file."""
    maps = [path for path in (outputs.depth, outputs.uncertainty) if path is not None]
    suffixes = [require_suffix(path, WRITABLE_DEPTH_SUFFIXES) for path in maps]
    if outputs.visualization is not None:
        require_suffix(outputs.visualization, (".png",))
    if outputs.point_cloud is not None:
        require_suffix(outputs.point_cloud, (".ply",))
        if settings.K is None:
            raise InputError("--point-cloud needs the camera: give --intrinsics")
    if settings.output_scale is not None and ".png" not in suffixes:
        raise InputError("--output-scale is for .png; the other formats hold metres")
    for name in ("depth_scale", "max_depth", "max_uncertainty", "output_scale"):
        value = getattr(settings, name)
        if value is not None and not 0 < value < float("inf"):
            raise InputError(f"--{name.replace('_', '-')} must be a positive number, not {value}")
    if inputs.depth is None and not settings.no_measurements:
        raise InputError(
            "DEPTH is missing; for relative depth from the image alone give --no-measurements"
        )
    if inputs.depth is None and inputs.confidence is not None:
        raise InputError("--confidence weighs measurements: give DEPTH too")
