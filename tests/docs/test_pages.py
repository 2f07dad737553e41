"""What the pages say is so: their snippets run, their options exist, their tables are whole."""

import re
from pathlib import Path
from typing import Any

import pytest
import torch
from PIL import Image
from typer.main import get_command

import steered_marigold
from docs import generated
from docs.argument_lists import listed
from steered_marigold.cli import app
from steered_marigold.diffusion.settings import KNOBS, PRESETS
from steered_marigold.methods.registry import METHODS
from tests.frames.completers import NearestCompleter, write_frame

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
RUN = [
    ROOT / "README.md",
    *(ROOT / "docs" / f"{name}.md" for name in ("start", "python", "evaluation")),
]
GROUP: Any = get_command(app)
COMMANDS: dict[str, Any] = GROUP.commands
# of other programs: pip, the modules of the recipe and of the benchmarks, ROS
FOREIGN_LINES = re.compile(r"python -m (training|rooms|benchmarks)|--ros-args|sha256sum|pytest")


def _snippets(page: Path) -> list[str]:
    return re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), re.M | re.S)


@pytest.fixture
def names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """What the snippets take for granted: files in the present folder, and variables."""
    monkeypatch.chdir(tmp_path)
    for image, depth in (("image", "depth"), ("color", "measured")):
        write_frame(tmp_path / f"{image}.png", tmp_path / f"{depth}.png", seed=0)
    for index in (1, 2):
        for name in ("rgb", "depth"):
            (tmp_path / "FRAMES" / name).mkdir(parents=True, exist_ok=True)
        folder = tmp_path / "FRAMES"
        write_frame(folder / "rgb" / f"000{index}.png", folder / "depth" / f"000{index}.png", index)
    picture = Image.open(tmp_path / "image.png").convert("RGB")
    sparse_depth = torch.full((picture.height, picture.width), 2.0)
    sparse_depth[:, ::3] = 0
    valid_mask = sparse_depth > 0
    return {
        "torch": torch,
        "image": picture,
        "depth": sparse_depth,
        "sparse_depth": sparse_depth,
        "valid_mask": valid_mask,
        "frames": [(picture, sparse_depth)] * 2,
        "targets": [],
        "create": lambda name: NearestCompleter(),
        **{f"image_{x}": picture for x in "ab"},
        **{f"depth_{x}": sparse_depth for x in "ab"},
        **{f"mask_{x}": valid_mask for x in "ab"},
    }


@pytest.mark.parametrize("page", RUN, ids=lambda page: page.stem)
def test_snippets_run(page: Path, names: dict[str, Any]) -> None:
    """One after the other, as one program; what a hub is needed for gets the embedded weights."""
    snippets = _snippets(page)
    assert snippets
    for snippet in snippets:
        here = snippet.replace('"prs-eth/marigold-depth-v1-1"', "EMBEDDED").replace(
            '"cuda"', '"cpu"'
        )
        names["EMBEDDED"] = generated.ROOT / "src" / "steered_marigold" / "assets" / "checkpoint"
        exec(compile(here, str(page), "exec"), names)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_options_exist(page: Path) -> None:
    known = {"--help", "--version", "--install-completion", "--show-completion"}
    for command in COMMANDS.values():
        known |= {name for p in command.params for name in (*p.opts, *p.secondary_opts)}
    lines = page.read_text(encoding="utf-8").replace("\\\n", " ").splitlines()
    ours = [
        line for line in lines if "steered-marigold " in line and not FOREIGN_LINES.search(line)
    ]
    named = {option for line in ours for option in re.findall(r"(?<![\w-])--[a-z][\w-]*", line)}
    assert named <= known


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_commands_and_methods_exist(page: Path) -> None:
    text = page.read_text(encoding="utf-8").replace("\\\n", "")
    commands = re.findall(r"^steered-marigold ([a-z]\w*)", text, re.M)
    assert set(commands) <= COMMANDS.keys()
    for methods in re.findall(r"--methods \"?([^\s\"`]+[^\s\"`,])", text):
        bases = {
            name.partition("@")[0] for name in methods.split(",") if "=" not in name or "@" in name
        }
        assert bases <= {*METHODS, "mine"}


def test_option_tables_are_whole() -> None:
    for name, command in COMMANDS.items():
        table = generated.option_table(name)
        for parameter in command.params:
            if parameter.param_type_name == "option" and parameter.name != "help":
                assert f"`{parameter.opts[0]}`" in table
    text = (ROOT / "docs" / "options.md").read_text(encoding="utf-8")
    assert all(f"## {name}\n" in text for name in COMMANDS)


def test_preset_table_is_whole() -> None:
    rows = [row.split(" | ") for row in generated.preset_table().splitlines()]
    assert [cell.strip("| `") for cell in rows[0][1:]] == list(PRESETS)
    values = {row[0].strip("| `"): [cell.strip("| `") for cell in row[1:]] for row in rows[2:]}
    for knob in KNOBS:
        assert values[knob] == [repr(preset.knobs[knob]) for preset in PRESETS.values()]


def test_only_its_alignment_sets_the_authors_uniform_run_apart() -> None:
    """As docs/presets.md says."""
    minmax = PRESETS["paper"].override(condition_alignment="minmax")
    assert PRESETS["paper-minmax"] == minmax


def test_the_reference_has_every_public_name() -> None:
    text = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    shown = re.findall(r"^::: steered_marigold\.[\w.]*?(\w+)$", text, re.M)
    assert set(steered_marigold.__all__) <= set(shown)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_files_of_the_repository_are_there(page: Path) -> None:
    for path in re.findall(r"^<!-- file (\S+) -->$", page.read_text(encoding="utf-8"), re.M):
        assert generated.file_text(path)


def test_links_of_included_pages_point_out_of_docs() -> None:
    text = generated.file_text("CONTRIBUTING.md")
    targets = [link for link in re.findall(r"\]\(([^)#]+)", text) if "://" not in link]
    assert targets
    assert all((ROOT / "docs" / target).is_file() for target in targets)


def test_named_sentences_become_items() -> None:
    text = (
        "Does it.\n\nFirst words. image: RGB, in 0..1.\nK, size: it: known. other: no.\n\nRaises X."
    )
    items = "First words.\n\n- **image**: RGB, in 0..1.\n- **K, size**: it: known. other: no."
    assert listed(text, {"image", "K", "size"}) == f"Does it.\n\n{items}\n\nRaises X."


def test_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 120
