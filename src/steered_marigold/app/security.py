"""Who may speak to the page: same-origin browsers, under a name of this machine, with a password.

Gradio answers a form that a foreign page posts; here every request must come from the page itself,
and what the page loads may only come from this server.
"""

import hmac
import ipaddress
import json
import re
from collections.abc import Awaitable, Callable, MutableMapping
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from steered_marigold.errors import FileFormatError, InputError
from steered_marigold.io.files import require_file

Scope = MutableMapping[str, Any]
App = Callable[[Scope, Any, Any], Awaitable[None]]

# Gradio builds functions from text and styles in place; nothing comes from elsewhere
_POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval' 'wasm-unsafe-eval'; "
    "style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; media-src 'self' data: blob:; "
    "connect-src 'self' data: blob:; font-src 'self' data:; worker-src 'self' blob:; "
    "object-src 'none'; base-uri 'self'; form-action 'self'; frame-ancestors 'none'"
)
_HEADERS = [
    (b"content-security-policy", _POLICY.encode()),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
]
_FETCHED = re.compile(r"/(file=\w+:/|proxy=)")  # paths under which Gradio fetches from elsewhere
_LOCAL_NAMES = ("localhost", "127.0.0.1", "::1")


def is_local(host: str) -> bool:
    """Whether only this machine can reach a server on that address."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


class SameOrigin:
    """Refuses requests from other origins, from other names of a local server, and for addresses.

    A page of another site that resolves its own name to 127.0.0.1 would else be one of ours; and
    Gradio fetches what a visitor names by its address where a file is expected.
    """

    def __init__(self, app: App, *, local: bool) -> None:
        self._app, self._local = app, local

    async def __call__(self, scope: Scope, receive: Any, send: Any) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        path = scope.get("path", "")
        if not self._allowed(dict(scope["headers"])) or _FETCHED.search(path):
            await _refuse(send)
            return
        if scope.get("method") == "POST" and not path.endswith("/upload"):
            body = await _read(receive)
            if _names_address(body):
                await _refuse(send)
                return
            receive = _again(body, receive)

        async def send_with_headers(message: MutableMapping[str, Any]) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", []), *_HEADERS]
            await send(message)

        await self._app(scope, receive, send_with_headers)

    def _allowed(self, headers: dict[bytes, bytes]) -> bool:
        host = headers.get(b"host", b"").decode("latin-1")
        origin = headers.get(b"origin")
        if origin is not None and urlsplit(origin.decode("latin-1")).netloc != host:
            return False
        if headers.get(b"sec-fetch-site") == b"cross-site" and origin is not None:
            return False
        return not self._local or urlsplit(f"//{host}").hostname in _LOCAL_NAMES


async def _read(receive: Any) -> bytes:
    body, more = b"", True
    while more:
        message = await receive()
        body += message.get("body", b"")
        more = message.get("more_body", False)
    return body


def _again(body: bytes, receive: Any) -> Any:
    """A `receive` that gives the body once more, then what comes after it."""
    given = False

    async def again() -> Any:
        nonlocal given
        if given:
            return await receive()
        given = True
        return {"type": "http.request", "body": body, "more_body": False}

    return again


def _names_address(body: bytes) -> bool:
    """Whether JSON names a file by an address."""
    try:
        waiting: list[Any] = [json.loads(body)]
    except ValueError:
        return False  # a form, such as that of the log-in
    while waiting:
        value = waiting.pop()
        if isinstance(value, dict):
            if "://" in str(value.get("path") or ""):
                return True
            waiting += value.values()
        elif isinstance(value, list):
            waiting += value
    return False


async def _refuse(send: Any) -> None:
    text = b"This page answers its own origin only."
    headers = [(b"content-type", b"text/plain"), (b"content-length", str(len(text)).encode())]
    await send({"type": "http.response.start", "status": 403, "headers": headers})
    await send({"type": "http.response.body", "body": text})


def read_auth_file(path: Path) -> Callable[[str, str], bool]:
    """Who may come in: lines of "name:password"; those that begin with # are comments.

    Raises FileFormatError for a file that is missing or holds anything else.
    """
    accounts: dict[str, bytes] = {}
    for number, line in enumerate(require_file(path).read_text("utf-8").splitlines(), start=1):
        if not line.strip() or line.startswith("#"):
            continue
        name, colon, password = line.partition(":")
        if not (name and colon and password):
            raise FileFormatError(f'{path}: line {number} is not "name:password"')
        accounts[name] = password.encode()
    if not accounts:
        raise FileFormatError(f'{path}: has no line "name:password"')

    def allowed(name: str, password: str) -> bool:
        known = accounts.get(name, b"")
        return hmac.compare_digest(known, password.encode()) and name in accounts

    return allowed


def require_safe(host: str, auth_file: Path | None) -> None:
    """InputError for an address that others can reach, without passwords."""
    if not is_local(host) and auth_file is None:
        raise InputError(
            f"`host` {host} can be reached by other machines: give `auth_file`, a file with lines "
            '"name:password"; or leave `host` at 127.0.0.1'
        )
