"""Arguments of the library, in the words of the command that was called."""

from collections.abc import Callable

import pytest
import typer
from typer.testing import CliRunner

from steered_marigold.cli import app
from steered_marigold.cli.messages import name_parameters, say, say_error, say_warning

Say = Callable[[object], None]


@pytest.fixture(autouse=True)
def _complete_was_called() -> None:
    command = typer.main.get_group(app).commands["complete"]
    name_parameters(command.params)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("is `depth_scale` right?", "is --depth-scale right?"),
        ("`no_measurements` gives", "--no-measurements gives"),
        ("`depth_grid=registered` takes", "--depth-grid registered takes"),
        ("`ensemble_size=4` makes", "--ensemble 4 makes"),
        ("give `num_inference_steps=2`", "give --steps 2"),
        ("`processing_resolution`, `K`", "--resolution, --intrinsics"),
        ("`image` and `sparse_depth`", "IMAGE and DEPTH"),
        ("`output` is `-o`", "--output is `-o`"),
        ("`valid_mask` and `latents=None`", "valid_mask and latents=None"),
        ("no argument: a\nb", "no argument: a b"),
    ],
)
def test_arguments_are_said_as_flags(
    capsys: pytest.CaptureFixture[str], text: str, said: str
) -> None:
    sayings: tuple[tuple[Say, str], ...] = (
        (say, ""),
        (say_error, "error: "),
        (say_warning, "warning: "),
    )
    for speak, before in sayings:
        speak(text)
        assert capsys.readouterr() == ("", f"{before}{said}\n")


def test_another_commands_flags_are_forgotten(capsys: pytest.CaptureFixture[str]) -> None:
    name_parameters(typer.main.get_group(app).commands["figures"].params)
    say("`run`, `output`, `depth_scale`")
    assert capsys.readouterr().err == "RUN, --output, depth_scale\n"


def test_every_flag_that_is_said_exists() -> None:
    """`--help` shows what messages of `complete` may name."""
    text = CliRunner().invoke(app, ["complete", "--help"], env={"COLUMNS": "200"}).stdout
    for flag in ("--depth-scale", "--no-measurements", "--depth-grid", "--ensemble", "--steps"):
        assert flag in text
