"""What README and docs show runs, and says what the code says."""

import re
from ast import literal_eval
from importlib.resources import files
from pathlib import Path

import pytest
import torch

from examples import complete_frame
from steered_marigold.diffusion.settings import KNOBS, PRESETS
from steered_marigold.io.depth_maps import read_depth
from steered_marigold.io.point_clouds import read_point_cloud

ROOT = Path(__file__).parents[1]
PAGES = [*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")]


def test_complete_frame(tmp_path: Path) -> None:
    if not (files("steered_marigold") / "assets" / "checkpoint" / "model_index.json").is_file():
        pytest.skip("the embedded checkpoint is not in this checkout")
    completion = complete_frame.main(tmp_path)
    sensor = read_depth(complete_frame.SAMPLE / "depth.png")
    trusted = completion.trusted[0]
    assert trusted.sum() > 0.9 * sensor.valid_mask.sum()
    assert torch.equal(completion.depth[0][trusted], sensor.depth[trusted])
    assert completion.uncertainty is not None
    sure = completion.uncertainty[0] < 0.05 * completion.depth[0]
    assert len(read_point_cloud(tmp_path / "cloud.ply").points) == int(sure.sum())
    assert torch.equal(read_depth(tmp_path / "depth.exr").depth, completion.depth[0])


def test_preset_table_of_the_docs() -> None:
    text = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)` \| `(.+)` \| `(.+)` \| `(.+)` \|$", text, re.MULTILINE)
    shown = {name: [literal_eval(cell) for cell in cells] for name, *cells in rows}
    presets = [PRESETS[name] for name in ("default", "fast", "paper")]
    expected = {name: [preset.knobs[name] for preset in presets] for name in KNOBS}
    for name in ("prompt_tokens", "minimum_depth", "dtype"):
        expected[name] = [getattr(preset, name) for preset in presets]
    assert shown == expected


def test_only_its_alignment_sets_the_authors_uniform_run_apart() -> None:
    text = " ".join((ROOT / "docs" / "api.md").read_text(encoding="utf-8").split())
    assert '`paper-minmax` is `paper` with `condition_alignment="minmax"`' in text
    paper = PRESETS["paper"]
    assert PRESETS["paper-minmax"] == paper.override(condition_alignment="minmax")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_between_pages(page: Path) -> None:
    links = re.findall(r"\]\(((?!https?:)[^)#]+\.(?:md|py))[^)]*\)", page.read_text("utf-8"))
    assert [link for link in links if not (page.parent / link).is_file()] == []
