"""Access control of the studio: only the browser that opened the link, on this machine, and no other page in it.

Every request passes through `Guard`, whatever its route. The studio has no accounts: its user is authenticated by the
secret in the link, which is exchanged for a cookie.
"""

from __future__ import annotations

import asyncio
import hmac
import secrets
from collections.abc import Iterable
from dataclasses import dataclass, field
from urllib.parse import parse_qs

from starlette.exceptions import HTTPException
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

OPEN = "/open"
SAFE = ("GET", "HEAD")
MOST_BODY_BYTES = 4_000_000  # a pasted table of ten thousand runs has less than one
BODY_S = 10.0  # a body of that size over the loopback takes milliseconds
CONTENT_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; connect-src 'self'; "
    "font-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS = (
    (b"content-security-policy", CONTENT_POLICY.encode()),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"x-frame-options", b"DENY"),
)


@dataclass(frozen=True)
class Secrets:
    """token: in the opening link; session: in the cookie."""

    token: str = field(default_factory=lambda: secrets.token_urlsafe(32))
    session: str = field(default_factory=lambda: secrets.token_urlsafe(32))


class Guard:
    """ASGI middleware: Host, Origin, cookie, size and time of every request; strict headers on every answer."""

    def __init__(self, app: ASGIApp, port: int, known: Secrets) -> None:
        """Guard an application that listens on a port of the loopback."""
        self._app, self._secrets = app, known
        self._hosts = frozenset(f"{name}:{port}".encode() for name in ("127.0.0.1", "localhost", "[::1]"))
        self._origins = frozenset(b"http://" + host for host in self._hosts)
        self._cookie = f"turnscope_studio_{port}"  # cookies are shared between ports, studios must not be

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or refuse it with one sentence."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        if scope["type"] != "http":
            return
        refused = self._refusal(scope)
        if refused is not None:
            await refused(scope, receive, _with_headers(send))
            return
        await self._app(scope, _bounded(receive), _with_headers(send))

    def _refusal(self, scope: Scope) -> Response | None:
        """The answer to a request that must not reach the application."""
        headers: list[tuple[bytes, bytes]] = scope["headers"]
        if not _only(headers, b"host", self._hosts):
            return _plain(403, "The studio answers to 127.0.0.1 only.")
        if self._is_of_another_page(scope):
            return _plain(403, "Another page must not use the studio.")
        if scope["path"] == OPEN:
            return self._opened(scope)
        if not self._has_cookie(headers):
            return _plain(401, "Open the studio by the link that `turnscope studio` printed.")
        lengths = [value for name, value in headers if name == b"content-length"]
        if any(not value.isdigit() or int(value) > MOST_BODY_BYTES for value in lengths):
            return _plain(413, "The request is too large.")
        return None

    def _is_of_another_page(self, scope: Scope) -> bool:
        headers, changes = scope["headers"], scope["method"] not in SAFE
        if (changes or any(name == b"origin" for name, _ in headers)) and not _only(headers, b"origin", self._origins):
            return True
        sites = [value for name, value in headers if name == b"sec-fetch-site"]
        # The opening link may be followed from any program, because it contains its own secret.
        return scope["path"] != OPEN and any(site not in (b"same-origin", b"none") for site in sites)

    def _opened(self, scope: Scope) -> Response:
        given = parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])[0]
        if scope["method"] not in SAFE or not hmac.compare_digest(given.encode(), self._secrets.token.encode()):
            return _plain(401, "This link is of another studio; use the one that `turnscope studio` printed last.")
        answer = RedirectResponse("/", status_code=303)
        answer.set_cookie(self._cookie, self._secrets.session, httponly=True, samesite="strict", path="/")
        return answer

    def _has_cookie(self, headers: Iterable[tuple[bytes, bytes]]) -> bool:
        wanted = f"{self._cookie}={self._secrets.session}".encode()
        given = [part.strip() for name, value in headers if name == b"cookie" for part in value.split(b";")]
        return any(hmac.compare_digest(part, wanted) for part in given)


def _only(headers: Iterable[tuple[bytes, bytes]], name: bytes, allowed: frozenset[bytes]) -> bool:
    """Whether a header occurs exactly once and is allowed."""
    values = [value for key, value in headers if key == name]
    return len(values) == 1 and values[0].lower() in allowed


def _plain(status: int, sentence: str) -> Response:
    return PlainTextResponse(sentence + "\n", status)


def _with_headers(send: Send) -> Send:
    async def sending(message: Message) -> None:
        if message["type"] == "http.response.start":
            there = {name for name, _ in message["headers"]}
            extra = [(b"cache-control", b"no-store")] if b"cache-control" not in there else []
            message = {**message, "headers": [*message["headers"], *HEADERS, *extra]}
        await send(message)

    return sending


def _bounded(receive: Receive) -> Receive:
    """Receive a body of at most MOST_BODY_BYTES within BODY_S; messages after it (disconnection) have no limit."""
    size, ended = 0, False
    began: float | None = None

    async def receiving() -> Message:
        nonlocal size, ended, began
        if ended:
            return await receive()
        now = asyncio.get_running_loop().time()
        began = now if began is None else began
        try:
            message = await asyncio.wait_for(receive(), max(began + BODY_S - now, 0.001))
        except TimeoutError as error:
            raise HTTPException(408, "The request is too slow.") from error
        size += len(message.get("body", b""))
        if size > MOST_BODY_BYTES:
            raise HTTPException(413, "The request is too large.")
        ended = not message.get("more_body", False)
        return message

    return receiving
