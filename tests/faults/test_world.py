"""What happens around a run: disks, permissions, names, signals, closed pipes."""

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import typer

from steered_marigold.batch.job import JobSettings, Outcome, plan
from steered_marigold.batch.run import complete_all
from steered_marigold.cli import OneLineErrors, main
from steered_marigold.errors import InputError
from steered_marigold.frames.outputs import Outputs
from steered_marigold.frames.sources import FrameFiles, Reading, folder_source
from tests.batch.workers import load
from tests.faults.children import Child
from tests.frames.completers import write_frames

pytestmark = [
    pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork"),
    pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning"),
]

HOW = {"completing": {"seed": 0}}
NOBODY = 65534


def _run(inputs: FrameFiles, outputs: Outputs, suffix: str = ".npy") -> list[Outcome]:
    source = folder_source(inputs, Reading())
    todo = plan(source, outputs, suffix=suffix, overwrite=False)
    return list(complete_all(load, todo, JobSettings(), HOW))


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 64 kB."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(disk)]
    if shutil.which("mount") is None or subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("mounting is not allowed here")
    yield disk
    subprocess.run(["umount", str(disk)], check=True)


@pytest.mark.parametrize("suffix", [".npy", ".png", ".tiff", ".exr"])
def test_a_full_disk_ends_the_run_and_leaves_whole_frames(
    small_disk: Path, tmp_path: Path, suffix: str
) -> None:
    names = [str(number) for number in range(40)]
    inputs = write_frames(tmp_path, names)
    out = Outputs(depth=small_disk / "depth", uncertainty=small_disk / "sure")
    outcomes = _run(inputs, out, suffix)
    assert outcomes[-1].ends_run
    assert any(x in str(outcomes[-1].error) for x in ("No space left", "is the disk full?"))
    assert 0 < len(outcomes) < len(names)
    for folder in (small_disk / "depth", small_disk / "sure"):
        files = [path for path in folder.iterdir() if path.name != ".run"]
        assert not [path.name for path in files if path.name.startswith(".")]
        assert all(path.stat().st_size > 0 for path in files)
    depths = {path.name for path in (small_disk / "depth").glob(f"*{suffix}")}
    assert depths == {path.name for path in (small_disk / "sure").glob(f"*{suffix}")}


def test_a_folder_that_may_not_be_written_to(tmp_path: Path) -> None:
    inputs = write_frames(tmp_path, ["0"])
    out = tmp_path / "out"
    out.mkdir()
    out.chmod(0o555)
    for folder in (tmp_path, *tmp_path.parents):
        if folder.stat().st_uid == os.getuid() and folder != Path("/"):
            folder.chmod(folder.stat().st_mode | 0o055)

    def work() -> None:
        if os.getuid() == 0:  # root may write anywhere
            os.setuid(NOBODY)
        with pytest.raises(InputError, match=r"out.*(cannot be|Permission)"):
            _run(inputs, Outputs(depth=out))

    child = Child(work, tmp_path / "said")
    assert child.wait() == 0, child.said()
    assert list(out.iterdir()) == []


@pytest.mark.skipif(not Path("/dev/shm").is_dir(), reason="needs another file system")
def test_results_on_another_file_system(tmp_path: Path) -> None:
    other = Path("/dev/shm") / f"steered-marigold-{os.getpid()}"
    try:
        inputs = write_frames(tmp_path, ["0"])
        assert [x.error for x in _run(inputs, Outputs(depth=other))] == [None]
        assert (other / "0.npy").is_file()
    finally:
        shutil.rmtree(other, ignore_errors=True)


def test_an_input_that_vanishes_costs_its_frame(tmp_path: Path) -> None:
    inputs = write_frames(tmp_path, ["0", "1", "2"])
    source = folder_source(inputs, Reading())
    todo = plan(source, Outputs(depth=tmp_path / "out"), suffix=".npy", overwrite=False)
    outcomes = complete_all(load, todo, JobSettings(), HOW)
    first = next(outcomes)
    (inputs.image / "1.png").unlink()
    second, third = outcomes
    assert (first.error, third.error) == (None, None)
    assert "1.png: no such file" in str(second.error)


@pytest.mark.skipif(sys.platform == "darwin", reason="names are UTF-8 there")
def test_names_with_any_bytes(tmp_path: Path) -> None:
    names = ["two\nlines", os.fsdecode(b"caf\xe9"), "  ", "ünï", '"quoted"', "-o"]
    outcomes = _run(write_frames(tmp_path, names), Outputs(depth=tmp_path / "out"))
    assert [x.error for x in outcomes] == [None] * len(names)
    assert {path.stem for path in (tmp_path / "out").glob("*.npy")} == set(names)


def _command(inputs: FrameFiles, out: Path, *more: str) -> None:
    sys.argv = ["steered-marigold", "complete", str(inputs.image), str(inputs.depth)]
    sys.argv += ["-o", str(out), "--preset", "fast", "--device", "cpu", "--threads", "1", *more]
    main()


@pytest.mark.parametrize(
    ("number", "code", "word"),
    [(signal.SIGINT, 130, "stopped"), (signal.SIGTERM, 143, "terminated")],
)
def test_a_signal_ends_a_run_with_a_count(
    tmp_path: Path, number: int, code: int, word: str
) -> None:
    inputs, out = write_frames(tmp_path, [str(n) for n in range(200)]), tmp_path / "out"
    child = Child(lambda: _command(inputs, out), tmp_path / "said")
    child.until(lambda: any(out.glob("*.png")))
    assert child.end(number, 0) == code, child.said()
    (line,) = [line for line in child.said().splitlines() if line.startswith(word)]
    done = list(out.glob("*.png"))
    assert f"{len(done)} completed" in line or f"{len(done) - 1} completed" in line
    assert "Traceback" not in child.said()
    assert not list(out.glob(".*.tmp*"))


def test_a_closed_pipe_and_a_full_stdout(tmp_path: Path) -> None:
    inputs = write_frames(tmp_path, ["0", "1"])
    reading, writing = os.pipe()
    os.close(reading)
    piped = Child(
        lambda: _command(inputs, tmp_path / "a", "--json"), tmp_path / "said", stdout=writing
    )
    os.close(writing)
    assert piped.wait() == 141, piped.said()
    assert "Traceback" not in piped.said()
    full = os.open("/dev/full", os.O_WRONLY)
    child = Child(lambda: _command(inputs, tmp_path / "b"), tmp_path / "told", stdout=full)
    os.close(full)
    assert child.wait() == 1, child.said()
    assert "error: OSError: [Errno 28] No space left on device" in child.said()
    assert "Traceback" not in child.said()


def test_what_nobody_foresaw_is_one_line(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    app = typer.Typer(cls=OneLineErrors, pretty_exceptions_enable=False)

    @app.command()
    def fail() -> None:
        raise KeyError("of\nnobody")

    @app.command()
    def rest() -> None:
        pass

    with pytest.raises(SystemExit) as ended:
        app(["fail"])
    assert ended.value.code == 1
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err == "error: KeyError: 'of\\nnobody' (STEERED_MARIGOLD_DEBUG=1 shows where)\n"
    monkeypatch.setenv("STEERED_MARIGOLD_DEBUG", "1")
    with pytest.raises(KeyError):
        app(["fail"])
