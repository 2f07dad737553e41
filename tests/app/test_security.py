"""Who may speak to the page."""

import asyncio
from pathlib import Path
from typing import Any

import pytest

from steered_marigold.app.security import SameOrigin, read_auth_file, require_safe
from steered_marigold.errors import FileFormatError, InputError


async def _answers(scope: Any, receive: Any, send: Any) -> None:
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": b"the page"})


async def _echoes(scope: Any, receive: Any, send: Any) -> None:
    message = await receive()
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": message["body"]})


def _post(body: bytes, path: str = "/gradio_api/queue/join") -> tuple[int, bytes]:
    """Status and body of the answer to a request in two parts."""
    sent: list[Any] = []
    parts = [body[:5], body[5:]]

    async def receive() -> Any:
        return {"type": "http.request", "body": parts.pop(0), "more_body": bool(parts)}

    async def send(message: Any) -> None:
        sent.append(message)

    scope = {"type": "http", "method": "POST", "path": path, "headers": [(b"host", b"localhost")]}
    asyncio.run(SameOrigin(_echoes, local=True)(scope, receive, send))
    return sent[0]["status"], sent[1]["body"]


def _ask(*, local: bool, **headers: str) -> tuple[int, dict[bytes, bytes]]:
    """Status and headers of the answer to a request with these headers."""
    sent: list[Any] = []

    async def send(message: Any) -> None:
        sent.append(message)

    pairs = [(k.replace("_", "-").encode(), v.encode()) for k, v in headers.items()]
    scope = {"type": "http", "headers": pairs}
    asyncio.run(SameOrigin(_answers, local=local)(scope, None, send))
    return sent[0]["status"], dict(sent[0]["headers"])


@pytest.mark.parametrize(
    ("status", "local", "headers"),
    [
        (200, True, {"host": "127.0.0.1:7860"}),
        (200, True, {"host": "localhost:7860", "origin": "http://localhost:7860"}),
        (200, True, {"host": "[::1]:7860"}),
        (403, True, {"host": "127.0.0.1:7860", "origin": "http://evil.example"}),
        (403, True, {"host": "127.0.0.1:7860", "origin": "http://127.0.0.1:8000"}),
        (403, True, {"host": "127.0.0.1:7860", "origin": "null"}),
        (403, True, {"host": "evil.example:7860"}),  # a name that was made to lead here
        (403, True, {}),
        (200, False, {"host": "lab.example", "origin": "https://lab.example"}),
        (403, False, {"host": "lab.example", "origin": "https://evil.example"}),
    ],
)
def test_only_its_own_origin_is_answered(status: int, local: bool, headers: dict[str, str]) -> None:
    answered, sent = _ask(local=local, **headers)
    assert answered == status
    if status == 200:
        policy = sent[b"content-security-policy"].decode()
        assert "default-src 'self'" in policy
        assert "http" not in policy


def test_the_server_fetches_nothing_for_a_visitor() -> None:
    own = b'{"data": [{"path": "/tmp/x.png", "url": "http://localhost/file=/tmp/x.png"}, "a://b"]}'
    assert _post(own) == (200, own)
    assert _post(b"username=a&password=b", "/login") == (200, b"username=a&password=b")
    for file in ('{"path": "http://a.example/x"}', '{"path": "\\u0068ttps://a.example/x"}'):
        assert _post(f'{{"data": [[{file}]]}}'.encode())[0] == 403
    for path in ("/gradio_api/file=http://a.example/x", "/gradio_api/proxy=http://a.example/x"):
        assert _post(b"{}", path)[0] == 403


def test_accounts_are_read_and_checked(tmp_path: Path) -> None:
    file = tmp_path / "accounts"
    file.write_text("# the lab\nanna:se:cret\n\nbo:ü\n", "utf-8")
    allowed = read_auth_file(file)
    assert allowed("anna", "se:cret")
    assert allowed("bo", "ü")
    assert not allowed("anna", "ü")
    assert not allowed("nobody", "")
    assert not allowed("", "")


@pytest.mark.parametrize("text", ["", "# nothing\n", "anna\n", "anna:\n", ":secret\n"])
def test_bad_accounts_are_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "accounts").write_text(text)
    with pytest.raises(FileFormatError, match="accounts"):
        read_auth_file(tmp_path / "accounts")


@pytest.mark.parametrize("host", ["0.0.0.0", "192.168.0.7", "::", "lab.example"])
def test_an_address_for_others_needs_passwords(host: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="`auth_file`"):
        require_safe(host, None)
    require_safe(host, tmp_path)
    for local in ("127.0.0.1", "localhost", "::1"):
        require_safe(local, None)
