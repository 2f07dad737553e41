"""steered-marigold app: a page in the browser."""

from pathlib import Path
from typing import Annotated

from typer import Option

from steered_marigold.cli.options import option_panel

_limit = option_panel("What a visitor may ask for")


def app(
    *,
    host: Annotated[
        str, Option(help="Address to serve on; one that others can reach needs --auth-file.")
    ] = "127.0.0.1",
    port: Annotated[
        int | None, Option(min=1, max=65535, help="Its port.", show_default="free, from 7860 on")
    ] = None,
    auth_file: Annotated[
        Path | None, Option(help="Who may come in: a file with lines name:password.")
    ] = None,
    root: Annotated[
        Path | None, Option(help="Folder of frames and recordings that visitors may open.")
    ] = None,
    checkpoint: Annotated[
        list[str] | None,
        Option(help="A folder in Marigold's format, or a hub id, beside embedded; repeatable."),
    ] = None,
    device: Annotated[
        str | None, Option(help="cpu, cuda, mps.", show_default="the best there is")
    ] = None,
    max_upload: Annotated[int, _limit(min=1, help="Megabytes of a file.")] = 64,
    max_megapixels: Annotated[float, _limit(min=0.01, help="Of an image.")] = 12.0,
    max_seconds: Annotated[float, _limit(min=0.1, help="Of a run.")] = 300.0,
    max_queue: Annotated[int, _limit(min=1, help="Runs that wait.")] = 16,
) -> None:
    """Serve a page: complete a frame, draw holes into it, look at the depth in 3D.

    Only this machine can reach it, unless told otherwise. Ends with Ctrl-C; see docs/page.md.
    """
    from steered_marigold.app.actions import Limits
    from steered_marigold.app.server import Settings, serving
    from steered_marigold.diffusion.checkpoints import EMBEDDED

    settings = Settings(
        host=host,
        port=port,
        auth_file=auth_file,
        root=root,
        checkpoints={EMBEDDED: EMBEDDED} | {Path(c).name: c for c in checkpoint or []},
        device=device,
        limits=Limits(
            upload_mb=max_upload,
            megapixels=max_megapixels,
            seconds=max_seconds,
            queue=max_queue,
        ),
    )
    with serving(settings) as url:
        print(f"ready: {url}", flush=True)
        _wait()


def _wait() -> None:
    """Until Ctrl-C, or until the system asks the command to end."""
    import signal
    from threading import Event

    ended = Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.set())
    ended.wait()
