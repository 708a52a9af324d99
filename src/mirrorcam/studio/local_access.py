"""Who may talk to a server on this machine: pages that it served itself, and programs of this machine."""

from __future__ import annotations

import secrets

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import ClientDisconnect
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

HOSTS = ("127.0.0.1", "localhost", "[::1]")
LARGEST_BODY_BYTES = 2_000_000
LONGEST_LENGTH = 20
"""Digits of a stated length that are read as a number."""
FILES = "/files"
"""Where the pages of built devices are, which carry their scripts and styles in themselves."""
_ALONE = "default-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'; "


class LocalAccess:
    """Refuses requests for other hosts' names and from other sites' pages, and bodies that are too large.

    A page of another site that a browser shows could otherwise talk to this machine: by a name that leads here (the
    Host is that name then), or by a form or a script (the Origin is that site then). Answers tell the browser to fetch
    nothing from anywhere else and to run no script but those of the page.
    """

    def __init__(self, app: ASGIApp, port: int) -> None:
        self._app = app
        self._hosts = {f"{host}:{port}" for host in HOSTS} | ({*HOSTS} if port == 80 else set())

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        refusal = self._refusal(Headers(scope=scope), scope["method"], scope["path"])
        if refusal:
            await PlainTextResponse(refusal, status_code=403)(scope, receive, send)
            return
        nonce = secrets.token_urlsafe(16)
        scope["nonce"] = nonce
        inline = "'unsafe-inline'" if scope["path"].startswith(f"{FILES}/") else f"'nonce-{nonce}'"
        policy = _ALONE + (
            f"script-src {inline}; style-src {inline}; img-src 'self' data: blob:; connect-src 'self' data: blob:"
        )

        begun = False

        async def with_policy(message: Message) -> None:
            nonlocal begun
            if message["type"] == "http.response.start":
                begun = True
                headers = MutableHeaders(scope=message)
                headers["Content-Security-Policy"] = policy
                headers["X-Content-Type-Options"] = "nosniff"
                headers["Referrer-Policy"] = "no-referrer"
                headers["Cross-Origin-Resource-Policy"] = "same-origin"
                headers.setdefault("Cache-Control", "no-store")
            await send(message)

        try:
            await self._app(scope, _limited(receive), with_policy)
        except ClientDisconnect:
            if not begun:
                await PlainTextResponse("the request has ended before its end", status_code=400)(scope, receive, send)

    def _refusal(self, headers: Headers, method: str, path: str) -> str:
        """Why a request is refused, empty where it is not."""
        if headers.get("host", "").lower() not in self._hosts:
            return "this server answers to the loopback address alone"
        origin = headers.get("origin")
        if origin is not None and not self._is_own(origin):
            return "the request comes from a page of another site"
        following_a_link = method == "GET" and headers.get("sec-fetch-mode") == "navigate"
        if headers.get("sec-fetch-site", "none") not in ("none", "same-origin") and not following_a_link:
            return "the request comes from a page of another site"
        if method == "POST" and not headers.get("content-type", "").startswith("application/json"):
            return "expected application/json"
        length = headers.get("content-length", "0") or "0"
        if not (length.isascii() and length.isdigit()):
            return "expected a number of bytes as its length"
        too_large = len(length) > LONGEST_LENGTH or int(length) > LARGEST_BODY_BYTES
        return "the request is too large" if too_large else ""

    def _is_own(self, origin: str) -> bool:
        return origin.lower() in {f"http://{host}" for host in self._hosts}


class BodyTooLarge(Exception):
    """A body that goes on beyond what a request may hold, whatever length it has stated."""


def _limited(receive: Receive) -> Receive:
    taken = 0

    async def limited() -> Message:
        nonlocal taken
        message = await receive()
        taken += len(message.get("body", b""))
        if taken > LARGEST_BODY_BYTES:
            raise BodyTooLarge(f"the request is longer than {LARGEST_BODY_BYTES} bytes")
        return message

    return limited
