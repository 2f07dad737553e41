"""The part that every stage shares: schedule, averaging, log, checkpoints, resuming."""

import csv
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel

Batch = dict[str, Tensor]
LossFunction = Callable[[Batch], dict[str, Tensor]]


@dataclass
class Trainer:
    """Trains `model` for `minutes`, with a warm-up and a cosine decay over that time.

    Minutes are the processor's for this process: a pause, or others on the machine, cost nothing.

    The loss function returns named scalars; "loss" is minimised. `run` holds `log.csv` and
    `last.pt` (weights and their exponential average; the optimiser restarts with its warm-up).
    procedural_only: whether these weights and this run's data are free of photographs; `last.pt`
    tells whether all runs were.
    """

    model: nn.Module
    groups: list[dict[str, object]]
    run: Path
    minutes: float
    procedural_only: bool
    ema_decay: float = 0.998
    average: AveragedModel = field(init=False)

    def __post_init__(self) -> None:
        self.run.mkdir(parents=True, exist_ok=True)
        if (self.run / "last.pt").exists():
            saved = torch.load(self.run / "last.pt", weights_only=True)
            self.model.load_state_dict(saved["model"])
            self.procedural_only &= saved.get("procedural_only", False)
        self.average = AveragedModel(self.model, multi_avg_fn=self._average)
        self.average.eval()
        if (self.run / "last.pt").exists():
            self.average.module.load_state_dict(saved["average"])
            # the first update of an AveragedModel copies; this one goes on averaging
            self.average.n_averaged += 1

    @torch.no_grad()
    def _average(self, average: Any, current: Any, updates: Tensor | int) -> None:
        """Exponential average whose memory grows with the run: the start is soon forgotten."""
        decay = min(self.ema_decay, (1 + int(updates)) / (10 + int(updates)))
        torch._foreach_lerp_(average, current, 1 - decay)

    def fit(
        self,
        data: Iterator[Batch],
        loss_function: LossFunction,
        validate: Callable[[nn.Module], dict[str, float]] | None = None,
        *,
        every_minutes: float = 5,
    ) -> None:
        """Runs until the time is up; logs means, validates the average and saves as it goes.

        every_minutes: of the clock on the wall, between two records.
        """
        optimiser = torch.optim.AdamW(self.groups, weight_decay=0.01, betas=(0.9, 0.98))
        peaks = [group["lr"] for group in optimiser.param_groups]
        start, last = time.process_time(), time.monotonic()
        sums: dict[str, float] = {}
        step = since = seen = 0
        while (elapsed := (time.process_time() - start) / 60) < self.minutes:
            rate = _rate(step, elapsed / self.minutes)
            for group, peak in zip(optimiser.param_groups, peaks, strict=True):
                group["lr"] = peak * rate
            batch = next(data)
            terms = loss_function(batch)
            optimiser.zero_grad(set_to_none=True)
            torch.autograd.backward(terms["loss"])
            nn.utils.clip_grad_norm_(self.model.parameters(), 1.0)
            optimiser.step()
            self.average.update_parameters(self.model)
            for name, value in terms.items():
                sums[name] = sums.get(name, 0.0) + float(value.detach())
            step, since, seen = step + 1, since + 1, seen + len(next(iter(batch.values())))
            if (time.monotonic() - last) / 60 >= every_minutes:
                last = time.monotonic()
                self._record(step, seen, elapsed, {k: v / since for k, v in sums.items()}, validate)
                sums, since = {}, 0
        if since:
            self._record(step, seen, elapsed, {k: v / since for k, v in sums.items()}, validate)

    def _record(
        self,
        step: int,
        seen: int,
        minutes: float,
        means: dict[str, float],
        validate: Callable[[nn.Module], dict[str, float]] | None,
    ) -> None:
        temporary = self.run / "last.pt.part"
        state = {
            "model": self.model.state_dict(),
            "average": self.average.module.state_dict(),
            "procedural_only": self.procedural_only,
        }
        torch.save(state, temporary)
        temporary.replace(self.run / "last.pt")
        row = {"step": step, "samples": seen, "minutes": minutes} | means
        if validate is not None:
            row |= validate(self.average.module)
        self._log({k: round(v, 5) for k, v in row.items()})

    def _log(self, row: dict[str, float]) -> None:
        path = self.run / "log.csv"
        new = not path.exists()
        with path.open("a", newline="") as file:
            writer = csv.DictWriter(file, fieldnames=list(row))
            if new:
                writer.writeheader()
            writer.writerow(row)
        print(" ".join(f"{k}={v:g}" for k, v in row.items()), flush=True)


def _rate(step: int, progress: float, warm_up: int = 100) -> float:
    """Share of the peak learning rate: linear warm-up, then half a cosine."""
    return min(1.0, (step + 1) / warm_up) * 0.5 * (1 + math.cos(math.pi * min(progress, 1.0)))
