"""The command line. Nothing heavy is imported before a command runs: `--help` is quick."""

import os
import sys
from io import TextIOWrapper
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from steered_marigold.cli import bag, complete, doctor, evaluate, figures, view
from steered_marigold.cli.app import app as page
from steered_marigold.cli.messages import name_parameters, say_error
from steered_marigold.errors import CheckpointError, InputError, SteeredMarigoldError

DEBUG_VARIABLE = "STEERED_MARIGOLD_DEBUG"
_CLOSED_PIPE = 128 + 13  # what a shell says of a program that SIGPIPE ended


class OneLineErrors(TyperGroup):
    """Errors become one line and an exit code, whether or not the package foresaw them."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        name, command, rest = super().resolve_command(ctx, args)
        if command is not None:
            name_parameters(command.params)
        return name, command, rest

    def invoke(self, ctx: Any) -> Any:
        try:
            result = super().invoke(ctx)
            sys.stdout.flush()  # a full disk or a closed pipe is told here, or never
            return result
        except SteeredMarigoldError as error:
            say_error(error)
            callers_fault = isinstance(error, InputError | CheckpointError)
            raise typer.Exit(2 if callers_fault else 1) from error
        except BrokenPipeError as error:
            _forget_stdout()
            raise typer.Exit(_CLOSED_PIPE) from error
        except Exception as error:
            of_typer = isinstance(error, typer.Abort) or hasattr(error, "exit_code")
            if of_typer or os.environ.get(DEBUG_VARIABLE):
                raise
            say_error(f"{_in_one_line(error)} ({DEBUG_VARIABLE}=1 shows where)")
            if isinstance(error, OSError):
                _forget_stdout()
            raise typer.Exit(1) from error


def _in_one_line(error: Exception) -> str:
    """What happened, in few words, for what was not foreseen."""
    if isinstance(error, MemoryError):
        return f"not enough memory {error}".strip()
    return f"{type(error).__name__}: {error}"


def _forget_stdout() -> None:
    """What it still holds cannot be written; the interpreter would try once more as it ends."""
    sys.stdout = Path(os.devnull).open("w")  # noqa: SIM115 (it lasts as long as the process)


app = typer.Typer(
    cls=OneLineErrors,
    help="Dense metric depth from one image plus whatever depth a sensor managed to measure.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
app.command("complete")(complete.complete)
app.command("bag")(bag.bag)
app.command("doctor")(doctor.doctor)
app.command("evaluate")(evaluate.evaluate)
app.command("figures")(figures.figures)
app.command("view")(view.view)
app.command("app")(page)


def _print_version(asked: bool) -> bool:
    if asked:
        from importlib.metadata import version

        print(version("steered-marigold"))
        raise typer.Exit()
    return asked


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version."
        ),
    ] = False,
) -> None:
    """Dense metric depth from one image plus whatever depth a sensor managed to measure."""


def main() -> None:
    """The `steered-marigold` command."""
    # names of files may hold bytes that are no UTF-8
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="surrogateescape")
    app(prog_name="steered-marigold")
