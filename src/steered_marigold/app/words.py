"""What the page says: the record in words, warnings, errors with the names of its own fields."""

from html import escape
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool
from torch import Tensor

from steered_marigold.core.completion import DepthCompletion
from steered_marigold.core.frame import Frame
from steered_marigold.core.metrics import NORMAL_90, depth_errors
from steered_marigold.core.notices import Notices, name_arguments
from steered_marigold.frames.complete import Record

# fields of the page by the name of the library's argument
_FIELDS = {
    "depth_scale": "Depth scale",
    "depth_encoding": "Encoding",
    "max_depth": "Farthest depth",
    "baseline": "Baseline",
    "intrinsics": "Camera",
    "K": "Camera",
    "depth_grid": "Lower resolution, same view",
    "sparse_depth": "the depth map",
    "steering_strength": "Steering strength",
    "preset": "Preset",
    "seed": "Seed",
}

NO_RESULT = "There is no result yet: press “Complete”."


def in_words_of_the_page(text: str, hidden: tuple[str, ...] = ()) -> str:
    """`max_depth`, an argument of the library in backticks, becomes “Farthest depth”, and so on.

    hidden: folders of the server, which are nobody's business.
    """
    for folder in hidden:
        text = text.replace(f"{folder}/", "")

    def named(name: str, value: str) -> str | None:
        field = _FIELDS.get(name)
        if field is None:
            return None
        return f"“{field}”" + (f" ({value})" if value and value != "registered" else "")

    return name_arguments(text, named)


def box(kind: str, text: str) -> str:
    """A paragraph that stands out. kind: "error", "warning", "note"."""
    if not text:
        return ""
    role = "alert" if kind == "error" else "status"
    return f'<p class="box {kind}" role="{role}">{escape(text)}</p>'


def warnings(notices: Notices, hidden: tuple[str, ...] = ()) -> str:
    """A box for each."""
    return "".join(box("warning", in_words_of_the_page(n.text, hidden)) for n in notices)


def facts(record: Record) -> str:
    """The numbers of a record as a list of sentences."""
    return "<ul class='facts'>" + "".join(f"<li>{x}</li>" for x in _sentences(record)) + "</ul>"


def _sentences(record: Record) -> list[str]:
    r: dict[str, Any] = dict(record.values)
    steps = "1 step" if r["steps"] == 1 else f"{r['steps']} steps"
    how = "steered" if r["steers"] else "not steered"
    said = [
        f"Completed in <b>{r['seconds']:.1f} s</b> by preset {escape(r['preset'])} "
        f"({steps}, {how}) on {escape(r['device'])} in {escape(r['dtype'])}, seed {r['seed']}."
    ]
    if not r["metric"]:
        return [*said, "Nothing was measured: depth is <b>relative</b>, from 0 to 1."]
    said.append(
        f"Depth from <b>{r['depth_min_m']:.2f}</b> to <b>{r['depth_max_m']:.2f} m</b>; "
        f"{r['input_valid_fraction']:.1%} of the pixels were measured."
    )
    if r["untrusted"]:
        said.append(
            f"<b>{r['untrusted']:,}</b> measurements contradict the others and were not believed."
        )
    if r["floored"]:
        said.append(f"{r['floored']:,} pixels were raised to the least depth.")
    left_out = {k: n for k, n in (r["treated_as_missing"] or {}).items() if n and k != "zero"}
    if left_out:
        listed = ", ".join(f"{n:,} {k.replace('_', ' ')}" for k, n in left_out.items())
        said.append(f"Left out of the depth map: {listed}.")
    return said


def hole_facts(
    completion: DepthCompletion, truth: Frame, erased: Bool[Tensor, "height width"]
) -> str:
    """How far the completion of the erased pixels is from what was measured there, in metres."""
    known = erased & truth.valid_mask
    count = int(known.sum())
    if not count:
        return box("note", "Nothing had been measured where you erased: there is no error to tell.")
    depth = completion.depth[0]
    errors = depth_errors(depth, truth.sparse_depth, known)
    distance = (depth - truth.sparse_depth)[known].abs()
    ninth = float(np.percentile(distance.numpy(), 90))
    said = (
        f"In the <b>{count:,}</b> erased pixels that had been measured, the result is off by "
        f"<b>{errors.mae_m:.3f} m</b> on average (RMSE {errors.rmse_m:.3f} m, nine in ten within "
        f"{ninth:.3f} m; {errors.abs_rel:.1%} of the depth)."
    )
    if completion.uncertainty is not None:
        inside = distance <= NORMAL_90 * completion.uncertainty[0][known]
        said += (
            f" The stated uncertainty covers {float(inside.to(torch.float32).mean()):.0%} of them; "
            "90% would be right."
        )
    return f'<p class="box hole" role="status">{said}</p>'
