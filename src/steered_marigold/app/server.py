"""Serves the page, to this machine alone unless passwords are asked for."""

import os
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import gradio as gr
from starlette.middleware import Middleware

from steered_marigold.app.actions import Actions, Limits
from steered_marigold.app.inputs import Disk
from steered_marigold.app.layout import FIRST_PRESET, static
from steered_marigold.app.page import build_page
from steered_marigold.app.running import Models
from steered_marigold.app.security import SameOrigin, is_local, read_auth_file, require_safe
from steered_marigold.app.sessions import Sessions
from steered_marigold.diffusion.checkpoints import EMBEDDED
from steered_marigold.errors import InputError

# fonts of the visitor's own machine
_SANS = ["system-ui", "Segoe UI", "Roboto", "Helvetica", "Arial", "sans-serif"]
_MONO = ["ui-monospace", "Menlo", "Consolas", "monospace"]


@dataclass(frozen=True, kw_only=True)
class Settings:
    """How the page is served.

    host, port: its address; port None is the first free one from 7860 on. auth_file: see
    `read_auth_file`. root: a folder whose frames visitors may open. checkpoints: by the name that
    the page shows, the first is chosen at first. device: as `load_pipeline` has it.
    """

    host: str = "127.0.0.1"
    port: int | None = None
    auth_file: Path | None = None
    root: Path | None = None
    checkpoints: Mapping[str, str] = field(default_factory=lambda: {EMBEDDED: EMBEDDED})
    device: str | None = None
    limits: Limits = field(default_factory=Limits)


@contextmanager
def serving(settings: Settings) -> Iterator[str]:
    """The page's address, as long as the block runs; every file of it is removed then.

    Raises InputError for an address that is not safe or not free, FileFormatError for a bad
    `auth_file`, CheckpointError if the first checkpoint cannot be loaded.
    """
    require_safe(settings.host, settings.auth_file)
    auth = None if settings.auth_file is None else read_auth_file(settings.auth_file)
    if settings.root is not None and not settings.root.is_dir():
        raise InputError(f"`root` {settings.root} is no folder")
    models = Models(settings.checkpoints, device=settings.device)
    models.completer(next(iter(settings.checkpoints)), preset=FIRST_PRESET)
    with tempfile.TemporaryDirectory(prefix="steered-marigold-") as temporary:
        os.environ["GRADIO_TEMP_DIR"] = temporary  # what is uploaded goes there, too
        sessions = Sessions(Path(temporary) / "sessions", most=settings.limits.visitors)
        disk = None if settings.root is None else Disk(root=settings.root)
        page = build_page(Actions(models, settings.limits, disk), sessions)
        try:
            yield _launch(page, settings, auth)
        finally:
            page.close(verbose=False)


def _launch(page: gr.Blocks, settings: Settings, auth: Callable[[str, str], bool] | None) -> str:
    middleware = [Middleware(SameOrigin, local=is_local(settings.host))]
    try:
        _, url, _ = page.launch(
            server_name=settings.host,
            server_port=settings.port,
            auth=auth,
            prevent_thread_lock=True,
            quiet=True,
            share=False,
            footer_links=[],
            enable_monitoring=False,
            run_history=False,
            ssr_mode=False,
            pwa=False,
            mcp_server=False,
            strict_cors=True,
            max_file_size=f"{settings.limits.upload_mb}mb",
            state_session_capacity=settings.limits.visitors,
            allowed_paths=[],
            app_kwargs={
                "middleware": middleware,
                "docs_url": None,
                "redoc_url": None,
                "openapi_url": None,
            },
            theme=_theme(),
            css=static("page.css"),
        )
    except OSError as error:
        raise InputError(f"`port` {settings.port} is not free: {error}") from error
    return str(url)


def _theme() -> gr.themes.Base:
    """Dark enough on light that everything can be read."""
    plain = gr.themes.Default(
        primary_hue="teal", neutral_hue="slate", font=_SANS, font_mono=_MONO, radius_size="md"
    )
    return plain.set(
        button_primary_background_fill="*primary_700",
        button_primary_background_fill_hover="*primary_800",
        slider_color="*primary_700",
        checkbox_background_color_selected="*primary_700",
        body_text_color_subdued="*neutral_600",
        body_text_color_subdued_dark="*neutral_300",
        block_info_text_color="*neutral_600",
        block_info_text_color_dark="*neutral_300",
    )
