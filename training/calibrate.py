"""Fits the constants of the uncertainty model on the tune frames: `python -m training.calibrate`.

In two steps. First all constants by quantile regression: they minimise the pinball loss of the 90 %
quantile of log |error|, every frame and protocol counting alike. Then, split-conformal by kind of
hole, the factors `by_kind` are set so that the 90 % interval covers 90 % of the pixels of that
kind, in the mean over the frames that the first step did not see. The second step's promise is
that of split-conformal prediction: for another frame drawn like these, 90 % in the mean, whatever
the model's shape; nothing for frames unlike them, and nothing for one frame.
"""

from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Annotated

import torch
import typer
from jaxtyping import Float
from torch import Tensor

from steered_marigold.core.alignment import fit_positive
from steered_marigold.core.holes import Hole, expect_beyond, find_holes
from steered_marigold.core.metrics import NORMAL_90
from steered_marigold.core.uncertainty import (
    DEFAULT_NOISE,
    Circumstances,
    UncertaintyModel,
    circumstances,
    relative_uncertainty,
)
from steered_marigold.datasets.folder import FrameFolder
from steered_marigold.evaluation.protocols import PreparedFrame, Protocol, frame_generator, prepare
from steered_marigold.methods.completer import DepthCompleter
from steered_marigold.methods.registry import create_method
from training.evaluation.subject import split_frames

PROTOCOLS = (
    Protocol(kind="range"),
    *(Protocol(kind="half", keep=keep) for keep in ("near", "far", "bottom", "left")),
    Protocol(kind="paper-erased"),
    Protocol(kind="objects"),
    Protocol(kind="shape"),
    Protocol(kind="paper-uniform"),
    Protocol(kind="paper-uniform", points=10),
)
PIXELS = 1500  # of a frame, evenly spread over what the protocol hides
STEPS, RATE = 400, 0.05  # of Adam; a thousand change no factor by 1 %
LEAST_ERROR = 1e-4  # of depth, for the logarithm
START = UncertaintyModel(
    near=0.006,
    reach=0.5,
    drift=0.2,
    length=0.03,
    origin=1.0,
    moved=0.5,
    farther=0.3,
    nearer=0.5,
    relief=10.0,
    by_kind=(1.0, 1.0, 1.5, 1.5),
)
_NAMES = tuple(field.name for field in fields(UncertaintyModel) if field.name != "by_kind")


class Sample:
    """What an answer's errors depend on in some pixels of a frame, and what they are.

    errors: of depth, as shares of the answer. around: as one column of pixels.
    """

    def __init__(self, method: DepthCompleter, frame: PreparedFrame) -> None:
        sparse, valid = frame.shown.sparse_depth, frame.shown.valid_mask
        generator = frame_generator(0, frame.shown.id, "method")
        answer = method.answer(frame.shown, generator=generator)
        affine, trusted, depth = answer.affine_depth, answer.trusted[0], answer.depth[0]
        assert affine is not None
        positive = fit_positive(affine, sparse, valid)
        prior, doubt = positive.map.apply(affine)[0], positive.doubt(affine)[0]
        holes = find_holes(prior, sparse, trusted)
        prior = expect_beyond(prior, holes)
        whole = circumstances(prior, depth, sparse, trusted, holes, doubt)
        asked = (frame.areas[frame.focus] & ~trusted).flatten().nonzero()[:, 0]
        at = asked[torch.linspace(0, len(asked) - 1, min(PIXELS, len(asked))).long()]
        errors = ((depth - frame.metric_depth) / depth).abs().flatten()[at]
        self.errors = errors.clamp(min=LEAST_ERROR)
        self.around = Circumstances(
            **{
                name: value if value.ndim == 0 else value.flatten()[at][:, None]
                for name, value in vars(whole).items()
            }
        )

    @property
    def kinds(self) -> Tensor:
        """The kind of hole of each pixel."""
        return self.around.kind[:, 0]

    def sigma(self, model: UncertaintyModel, factors: Tensor) -> Tensor:
        """The stated standard deviation of each pixel, as a share of depth."""
        plain = relative_uncertainty(replace(model, by_kind=(1.0, 1.0, 1.0, 1.0)), self.around)
        scaled = plain[:, 0] * factors[self.kinds]
        sigma: Tensor = (scaled.square() + DEFAULT_NOISE.fraction**2).sqrt()
        return sigma


def fit_model(samples: Sequence[Sample]) -> UncertaintyModel:
    """All constants, by quantile regression."""
    start = torch.tensor([*(getattr(START, name) for name in _NAMES), *START.by_kind]).log()
    logs = start.clone().requires_grad_()
    optimizer = torch.optim.Adam([logs], lr=RATE)
    for _ in range(STEPS):
        optimizer.zero_grad()
        values = logs.exp()
        model = _model(values)
        losses = [
            _pinball(sample.errors, sample.sigma(model, values[len(_NAMES) :]))
            for sample in samples
        ]
        # a weak pull keeps what the frames say nothing of
        loss = torch.stack(losses).mean() + 0.002 * (logs - start).square().sum()
        loss.backward()  # type: ignore[no-untyped-call]
        optimizer.step()
    values = logs.detach().exp()
    found = {name: float(value) for name, value in zip(_NAMES, values, strict=False)}
    return UncertaintyModel(**found, by_kind=_four(values[len(_NAMES) :]))


def conformal(model: UncertaintyModel, samples: Sequence[Sample]) -> UncertaintyModel:
    """The model with factors by which the 90 % interval covers 90 % of each kind of hole."""
    factors = torch.tensor(model.by_kind)
    ratios: dict[Hole, list[Tensor]] = {hole: [] for hole in Hole}
    for sample in samples:
        kinds = sample.kinds
        ratio = sample.errors / (NORMAL_90 * sample.sigma(model, factors))
        for hole in Hole:
            if int((kinds == hole).sum()) >= 30:  # fewer pixels are no share
                ratios[hole].append(ratio[kinds == hole])
    for hole, found in ratios.items():
        if found:
            factors[hole] *= _covering(found)
    return replace(model, by_kind=_four(factors))


def coverage(model: UncertaintyModel, sample: Sample) -> float:
    """Share of the sample's errors within the 90 % interval."""
    sigma = sample.sigma(model, torch.tensor(model.by_kind))
    return float((sample.errors <= NORMAL_90 * sigma).float().mean())


def _covering(ratios: Sequence[Tensor]) -> float:
    """The factor at which, in the mean over frames, 90 % of the ratios are below it."""
    low, high = 0.05, 20.0
    for _ in range(40):
        middle = (low * high) ** 0.5
        covered = sum(float((ratio <= middle).float().mean()) for ratio in ratios) / len(ratios)
        low, high = (middle, high) if covered < 0.9 else (low, middle)
    return high


def _pinball(errors: Float[Tensor, " n"], sigma: Float[Tensor, " n"]) -> Tensor:
    rest = errors.log() - (NORMAL_90 * sigma).log()
    return torch.maximum(0.9 * rest, -0.1 * rest).mean()


def _model(values: Tensor) -> UncertaintyModel:
    """A model whose constants are tensors that gradients flow through."""
    named = dict(zip(_NAMES, values, strict=False))
    return UncertaintyModel(**named, by_kind=(1.0, 1.0, 1.0, 1.0))


def _four(values: Tensor) -> tuple[float, float, float, float]:
    inside, beside, farther, nearer = values.tolist()
    return inside, beside, farther, nearer


def calibrate(
    nyuv2: Annotated[Path, typer.Option(help="NYUv2 folder.")],
    method: Annotated[str, typer.Option(help="As in `steered-marigold evaluate`.")] = "steered",
    checkpoint: Annotated[str, typer.Option(help="embedded, or a folder.")] = "embedded",
    limit: Annotated[int | None, typer.Option(help="Tune frames, evenly spaced.", min=4)] = None,
) -> None:
    """Print the constants for `CALIBRATED`, and the coverage of each protocol on both halves."""
    frames, completer = FrameFolder(nyuv2), create_method(method, checkpoint=checkpoint)
    halves: tuple[list[Sample], list[Sample]] = ([], [])
    names: tuple[list[str], list[str]] = ([], [])
    ids = split_frames("tune", limit)
    for number, frame_id in enumerate(ids):
        half = number * 2 // len(ids)  # contiguous, so that no room is in both
        for protocol in PROTOCOLS:
            frame = prepare(frames.load(frame_id), protocol, seed=0)
            if int(frame.areas[frame.focus].sum()) >= PIXELS:
                halves[half].append(Sample(completer, frame))
                names[half].append(protocol.name)
        typer.echo(f"{number + 1} of {len(ids)} frames", err=True)
    model = conformal(fit_model(halves[0]), halves[1])
    for title, samples, labels in zip(("fitted", "conformal"), halves, names, strict=True):
        for name in dict.fromkeys(labels):
            values = [coverage(model, s) for s, n in zip(samples, labels, strict=True) if n == name]
            typer.echo(f"{title}: {name}: {sum(values) / len(values):.3f}")
    for name in (*_NAMES, "by_kind"):
        value = getattr(model, name)
        shown = value if isinstance(value, tuple) else (value,)
        typer.echo(f"{name} = {', '.join(f'{x:.3g}' for x in shown)}")


if __name__ == "__main__":
    typer.run(calibrate)
