"""steered-marigold bag: a recording in, the same recording with dense depth out."""

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument

from steered_marigold.cli.engines import Count, counted
from steered_marigold.cli.messages import say, say_error, say_warning, warn_of
from steered_marigold.cli.options import Dtype, option_panel
from steered_marigold.cli.progress import progress_bar
from steered_marigold.errors import InputError

if TYPE_CHECKING:
    from steered_marigold.frames.complete import Record
    from steered_marigold.frames.recordings import Tally
    from steered_marigold.io.bags import CameraPoses
    from steered_marigold.methods.completer import DepthCompleter
    from steered_marigold.methods.streaming import StreamingCompleter

_topics = option_panel("Which topics and frames")
_write = option_panel("What to write")
_method = option_panel("How to complete")


def bag(
    recording: Annotated[
        Path, Argument(metavar="IN", help="A .bag, a ROS 2 bag's folder, a .mcap or a .db3.")
    ],
    *,
    output: Annotated[
        str,
        _write(
            "-o", "--output", help="A recording of the same kind, or FOLDER/ for frames as files."
        ),
    ],
    format: Annotated[
        str | None, _write(help="mcap or sqlite3.", show_default="that of IN")
    ] = None,
    uncertainty: Annotated[
        bool, _write("--uncertainty", help="Add the error's standard deviation, 32FC1 [m].")
    ] = False,
    max_uncertainty: Annotated[
        float | None, _write(help="Write 0 (unknown) where the uncertainty [m] is larger.")
    ] = None,
    rerun: Annotated[
        Path | None, _write(help="A .rrd of images, depth and clouds over time, for Rerun.")
    ] = None,
    overwrite: Annotated[bool, _write("--overwrite", help="Replace what is there.")] = False,
    image_topic: Annotated[str | None, _topics(help="Of colour.", show_default="found")] = None,
    depth_topic: Annotated[str | None, _topics(help="Of depth.", show_default="found")] = None,
    info_topic: Annotated[
        str | None, _topics(help="camera_info of the image.", show_default="found")
    ] = None,
    slop: Annotated[float, _topics(help="Stamps of a pair differ by no more seconds.")] = 0.02,
    every: Annotated[int, _topics(min=1, help="Take each n-th pair.")] = 1,
    start: Annotated[float, _topics(help="Seconds to skip.")] = 0.0,
    duration: Annotated[float | None, _topics(help="Seconds to take.", show_default="all")] = None,
    checkpoint: Annotated[
        str, _method(help="embedded, a folder, or a hub id in Marigold's format.")
    ] = "embedded",
    preset: Annotated[str, _method(help="default, or fast, for live rates on a CPU.")] = "fast",
    stream: Annotated[
        bool, _method("--stream", help="Frames know the ones before them: less flicker.")
    ] = False,
    fixed_frame: Annotated[
        str | None,
        _method(
            help="Of --stream: the frame of /tf that stands still; none: leave /tf aside.",
            show_default="odom, or the root above the camera",
        ),
    ] = None,
    seed: Annotated[int, _method(min=0, help="The same seed gives the same bytes.")] = 0,
    device: Annotated[
        str | None, _method(help="cpu, cuda, mps.", show_default="the best there is")
    ] = None,
    dtype: Annotated[
        Dtype | None, _method(help="What the model computes in.", show_default="the preset's")
    ] = None,
) -> None:
    """Complete the depth of a recording: ROS 1, ROS 2 (sqlite3, MCAP) or RealSense.

    Every message is copied as it is; dense depth is added as DEPTH_TOPIC/completed. See
    docs/recordings.md.
    """
    from steered_marigold.frames.recordings import complete_recording, save_recording
    from steered_marigold.frames.viewing import ViewedCompleter, rerun_log
    from steered_marigold.io.bags import open_recording
    from steered_marigold.methods.steered import SteeredCompleter
    from steered_marigold.methods.streaming import StreamingCompleter

    if fixed_frame is not None and not stream:
        raise InputError("`fixed_frame` is of `stream`")
    model: dict[str, Any] = {
        "checkpoint": checkpoint,
        "preset": preset,
        "device": device,
        "dtype": None if dtype is None else dtype.value,
    }
    with ExitStack() as stack:
        opened = stack.enter_context(
            open_recording(
                recording, image_topic=image_topic, depth_topic=depth_topic, info_topic=info_topic
            )
        )
        say(f"image {opened.image_topic}, depth {opened.depth_topic}")
        poses = None
        if stream and fixed_frame != "none":
            poses = stack.enter_context(opened.camera_poses(fixed_frame))
        frames = opened.frames(slop=slop, every=every, start=start, duration=duration, poses=poses)
        method = StreamingCompleter if stream else SteeredCompleter
        completer: DepthCompleter = method.from_checkpoint(**model)
        if isinstance(completer, StreamingCompleter):
            # after the recording is through, also where it ends early
            stack.callback(_tell_motion, completer, poses)
        if rerun is not None:
            completer = ViewedCompleter(completer, stack.enter_context(rerun_log(rerun)))
        how: dict[str, Any] = {"seed": seed, "max_uncertainty": max_uncertainty}
        total = -(-opened.depth_count // every) if duration is None else None
        count = Count()
        with counted(count, resumes=False), progress_bar("completing", total) as bar:

            def on_frame(record: "Record | None", tally: "Tally") -> None:
                if record is not None:
                    warn_of(record.values["frame"], record)
                count.completed, count.failed = tally.completed, len(tally.failed)
                bar(tally.completed + len(tally.failed), total, "completing")

            if output.endswith("/"):
                tally = save_recording(completer, frames, Path(output), on_frame=on_frame, **how)
            else:
                copied, tally = complete_recording(
                    completer,
                    opened,
                    frames,
                    Path(output),
                    uncertainty=uncertainty,
                    format=format,
                    overwrite=overwrite,
                    on_frame=on_frame,
                    **how,
                )
                say(f"{copied.path}: {copied.copied} messages copied, {copied.added} added")
    for frame_id, error in tally.failed.items():
        say_error(f"{frame_id}: {error}")
    lone = frames.counts
    say(f"unpaired: {lone.unpaired_images} images, {lone.unpaired_depths} depth maps")
    if tally.failed:
        raise typer.Exit(1)


def _tell_motion(completer: "StreamingCompleter", poses: "CameraPoses | None") -> None:
    """How the camera's motion was known, in a line."""
    times = completer.motions
    joined = ""
    if poses is not None and poses.counts.found:
        joined = f" ({poses.camera_frame} in {poses.fixed_frame})"
    say(
        f"motion: {times['pose']} times from /tf{joined}, {times['odometry']} by odometry, "
        f"{times['flow']} by optical flow"
    )
    if poses is not None and poses.fixed_frame is not None and not poses.counts.found:
        say_warning(f"/tf never joins {poses.camera_frame} to `fixed_frame={poses.fixed_frame}`")
    if poses is not None and poses.counts.damaged:
        say_warning(f"{poses.counts.damaged} damaged messages of /tf were passed over")
