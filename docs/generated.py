"""What the site takes from the code instead of repeating it; a hook of MkDocs.

A line of a page that is one of these comments becomes what it names:

    <!-- options of COMMAND -->   the command's arguments and options
    <!-- presets -->              every knob and its value in every preset
    <!-- file PATH -->            a file of the repository: Markdown as it is, else as code
"""

import posixpath
import re
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
_MARKER = re.compile(r"^<!-- (options of|presets|file)(?: (\S+))? -->$", re.MULTILINE)
_LANGUAGES = {".py": "python", ".sh": "sh", ".yml": "yaml"}


def on_page_markdown(markdown: str, **_: Any) -> str:
    """The page with its comments replaced."""
    makers: dict[str, Callable[[str], str]] = {
        "options of": option_table,
        "presets": lambda _: preset_table(),
        "file": file_text,
    }
    return _MARKER.sub(lambda match: makers[match[1]](match[2] or ""), markdown)


@cache
def option_table(command: str) -> str:
    """The arguments and options of a command, as `--help` has them."""
    from typer.main import get_command

    from steered_marigold.cli import app

    group: Any = get_command(app)
    context = group.make_context("steered-marigold", [], resilient_parsing=True)
    _, found, _ = group.resolve_command(context, [command])
    rows = [
        (_names(parameter), _default(parameter), (parameter.help or "").replace("\\[", "["))
        for parameter in found.params
        if parameter.name not in ("help", "install_completion", "show_completion")
    ]
    return _table(("option", "default", "meaning"), rows)


def preset_table() -> str:
    """Every knob and what belongs to a preset alone, and their values in every preset."""
    from steered_marigold.diffusion.settings import PRESETS

    rows = [
        (f"`{knob}`", *(f"`{preset.knobs[knob]!r}`" for preset in PRESETS.values()))
        for knob in next(iter(PRESETS.values())).knobs
    ]
    rows += [
        (name, *(f"`{getattr(preset, name)!r}`" for preset in PRESETS.values()))
        for name in ("least_share", "prompt_tokens", "dtype")
    ]
    return _table(("", *(f"`{name}`" for name in PRESETS)), rows)


def file_text(path: str) -> str:
    """A file of the repository; links of Markdown follow it into docs/, headings stay."""
    text = (ROOT / path).read_text(encoding="utf-8")
    language = _LANGUAGES.get(Path(path).suffix)
    if language:
        return f"```{language}\n{text.rstrip()}\n```"
    return re.sub(
        r"\]\((?!https?:|#)([^)]+)\)", lambda link: f"]({posixpath.relpath(link[1], 'docs')})", text
    )


def _names(parameter: Any) -> str:
    if parameter.param_type_name == "argument":
        return f"`{parameter.metavar or parameter.name.upper()}`"
    return ", ".join(f"`{name}`" for name in (*parameter.opts, *parameter.secondary_opts))


def _default(parameter: Any) -> str:
    """What stands in the place of an option that is not given."""
    shown = getattr(parameter, "show_default", None)
    if isinstance(shown, str):
        return shown
    if getattr(parameter, "is_flag", False) or parameter.default in (None, ()):
        return "required" if parameter.required else ""
    default = getattr(parameter.default, "value", parameter.default)
    return "required" if parameter.required else f"`{default}`"


def _table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    lines = [head, ("---",) * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
