"""The whole command against a server that answers as S3 does, where moto and s3fs are installed."""

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from urllib.request import urlopen

import pytest
from typer.testing import CliRunner

from steered_marigold.cli import app, complete
from steered_marigold.io.remote import location
from tests.frames.completers import NearestCompleter

pytest.importorskip("moto.server")
pytest.importorskip("s3fs")

PORT = 5581
KEYS = ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY")


@pytest.fixture
def bucket(frame_folders: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A bucket with three frames."""
    import fsspec

    address = f"http://127.0.0.1:{PORT}"
    for name in (*KEYS, "AWS_DEFAULT_REGION"):
        monkeypatch.setenv(name, "us-east-1")
    monkeypatch.setenv("AWS_ENDPOINT_URL", address)
    monkeypatch.setenv("AWS_EC2_METADATA_DISABLED", "true")
    command = [sys.executable, "-W", "ignore", "-m", "moto.server", "-p", str(PORT)]
    with subprocess.Popen(command, stderr=subprocess.DEVNULL) as server:
        try:
            _wait_for(address)
            fsspec.filesystem("s3", skip_instance_cache=True).mkdir("bucket")
            for folder in frame_folders:
                for path in folder.iterdir():
                    (location(f"s3://bucket/{folder.name}") / path.name).write_bytes(
                        path.read_bytes()
                    )
            yield location("s3://bucket")
        finally:
            server.terminate()


def _wait_for(address: str) -> None:
    for _ in range(300):
        try:
            urlopen(address).close()
            return
        except OSError:
            time.sleep(0.2)
    pytest.fail("moto does not answer")


@pytest.mark.filterwarnings("ignore")  # boto's
def test_buckets_in_and_out(
    bucket: Path,
    frame_folders: tuple[Path, Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(complete, "_load", lambda model, progress=False: NearestCompleter())

    def run(*arguments: object) -> tuple[int, str]:
        result = CliRunner().invoke(app, ["complete", *map(str, arguments)])
        return result.exit_code, result.stderr

    inputs, out = (bucket / "images", bucket / "depths"), bucket / "out"
    assert run(*frame_folders, "-o", tmp_path / "out")[0] == 0
    assert run(*inputs, "-o", out)[0] == 0
    for path in (tmp_path / "out").glob("*.png"):
        assert (out / path.name).read_bytes() == path.read_bytes()
    (out / "0001.png").unlink()
    assert "1 completed, 2 skipped, 0 failed" in run(*inputs, "-o", out)[1]
    code, said = run(*inputs, "-o", out, "--seed", 1)
    assert (code, "error: s3://bucket/out: its results were made with another" in said) == (2, True)
    single = bucket / "single.npy"
    assert run(inputs[0] / "0000.png", inputs[1] / "0000.png", "-o", single)[0] == 0
    assert single.is_file()
    for wrong in (("s3://other/images", inputs[1], "-o", out), (*inputs, "-o", "s3://other/out")):
        code, said = run(*wrong)
        assert (code, "error: s3://other/" in said) == (2, True)
    assert sorted(path.name for path in bucket.iterdir()) == [
        *("depths", "images", "out", "single.npy")
    ]


@pytest.mark.filterwarnings("ignore")
def test_missing_credentials_are_one_line(bucket: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import fsspec

    for name in KEYS:
        monkeypatch.delenv(name)
    monkeypatch.setenv("AWS_SHARED_CREDENTIALS_FILE", os.devnull)
    fsspec.get_filesystem_class("s3").clear_instance_cache()
    result = CliRunner().invoke(app, ["complete", str(bucket / "a.png"), str(bucket / "b.png")])
    assert (result.exit_code, result.stdout) == (2, "")
    assert "cannot be read (Unable to locate credentials)" in result.stderr
    fsspec.get_filesystem_class("s3").clear_instance_cache()
