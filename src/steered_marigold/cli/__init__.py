"""The command line. Nothing heavy is imported before a command runs: `--help` is quick."""

from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from steered_marigold.cli import bag, complete, doctor, evaluate, figures, view
from steered_marigold.cli.app import app as page
from steered_marigold.cli.messages import name_parameters, say_error
from steered_marigold.errors import CheckpointError, InputError, SteeredMarigoldError


class _OneLineErrors(TyperGroup):
    """Errors that the package raises on purpose become one line and an exit code."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        name, command, rest = super().resolve_command(ctx, args)
        if command is not None:
            name_parameters(command.params)
        return name, command, rest

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except SteeredMarigoldError as error:
            say_error(error)
            callers_fault = isinstance(error, InputError | CheckpointError)
            raise typer.Exit(2 if callers_fault else 1) from error


app = typer.Typer(
    cls=_OneLineErrors,
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
    app(prog_name="steered-marigold")
