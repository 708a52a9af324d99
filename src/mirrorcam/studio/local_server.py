"""A server on the loopback address: access control, error responses, static files, and shutdown."""

from __future__ import annotations

import secrets
import socket
import webbrowser
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import uvicorn
from pydantic_core import to_json
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import PlainTextResponse, Response
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, HTTPExceptionHandler, Message, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol

from mirrorcam.core.disk.files import validated
from mirrorcam.core.disk.nested_text import json_value
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import Value

LOOPBACK = "127.0.0.1"
DEFAULT_PORT, PORTS_TRIED = 8610, 20
ENDING_S = 2
"""Time for pending responses at shutdown."""


class _Protocol(H11Protocol):
    """HTTP of one connection. Invalid HTTP during a response closes the connection without another response.

    Otherwise, uvicorn would send a 400 within the other response, or the application would respond after the 400.
    """

    def send_400_response(self, msg: str) -> None:
        started = self.cycle is not None and self.cycle.response_started
        if self.cycle is not None:
            self.cycle.disconnected = True
            self.cycle.message_event.set()
        if started:
            self.transport.close()
        else:
            super().send_400_response(msg)


class _Server(uvicorn.Server):
    """A server that calls `end` before it waits for pending responses."""

    def __init__(self, config: uvicorn.Config, end: Callable[[], None]) -> None:
        super().__init__(config)
        self._end = end

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        self._end()
        await super().shutdown(sockets)


def listening_socket(port: int | None) -> socket.socket:
    """Return a listening socket on the loopback address; port 0 is any free one.

    For None, it is the first free port from DEFAULT_PORT on. Raises InputError if the port is in use.
    """
    for candidate in [port] if port is not None else [*range(DEFAULT_PORT, DEFAULT_PORT + PORTS_TRIED), 0]:
        # asyncio disables Nagle's algorithm only if the protocol is stated; otherwise bodies are delayed by 40 ms.
        listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP)
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listening.bind((LOOPBACK, candidate))
            listening.listen()
            return listening
        except OSError as error:
            listening.close()
            reason = error.strerror
    raise InputError(f"--port {port}: {reason}, expected a free one, or 0 for any")


def run_server(
    app: Starlette,
    listening: socket.socket,
    *,
    browser: bool,
    on_note: Callable[[str], None],
    end: Callable[[], None],
    fragment: str = "",
) -> None:
    """Serve until Ctrl-C; `end` is called after the last request, before the wait for pending responses.

    `fragment` follows # in the address of the page.
    """
    address = f"http://{LOOPBACK}:{listening.getsockname()[1]}/{fragment and '#'}{fragment}"
    config = uvicorn.Config(
        app, http=_Protocol, ws="none", log_level="error", timeout_graceful_shutdown=ENDING_S, server_header=False
    )
    on_note(f"{address} (Ctrl-C ends it)")
    if browser:
        webbrowser.open(address)
    try:
        _Server(config, end).run(sockets=[listening])
    except KeyboardInterrupt:  # raised by uvicorn after its shutdown
        on_note("ended")


HOSTS = ("127.0.0.1", "localhost", "[::1]")
LARGEST_BODY_BYTES = 2_000_000
MAX_LENGTH_DIGITS = 20
"""Largest number of digits of an accepted Content-Length."""
FILES = "/files"
"""Path of generated pages, whose scripts and styles are inline."""
_DENY_OTHERS = "default-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'; "


class LocalAccess:
    """Refuses requests with a different Host or from pages of other sites, and bodies that are too large.

    Otherwise, another site's page could reach this server: by a name that resolves to it (the Host is then that name),
    or by a form or script (the Origin is then that site). The content security policy of the responses permits only
    this origin and the page's own scripts.
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
        policy = _DENY_OTHERS + (
            f"script-src {inline}; style-src {inline}; img-src 'self' data: blob:; connect-src 'self' data: blob:"
        )

        started = False

        async def with_policy(message: Message) -> None:
            nonlocal started
            if message["type"] == "http.response.start":
                started = True
                headers = MutableHeaders(scope=message)
                headers["Content-Security-Policy"] = policy
                headers["X-Content-Type-Options"] = "nosniff"
                headers["Referrer-Policy"] = "no-referrer"
                headers["Cross-Origin-Resource-Policy"] = "same-origin"
                headers.setdefault("Cache-Control", "no-store")
            await send(message)

        try:
            await self._app(scope, receive, with_policy)
        except ClientDisconnect:
            if not started:
                await PlainTextResponse("the request was cut off", status_code=400)(scope, receive, send)

    def _refusal(self, headers: Headers, method: str, path: str) -> str:
        """Return why a request is refused; empty if it is accepted."""
        if headers.get("host", "").lower() not in self._hosts:
            return "this server accepts only the loopback address"
        origin = headers.get("origin")
        if origin is not None and not self._is_own(origin):
            return "the request comes from a page of another site"
        follows_link = method == "GET" and headers.get("sec-fetch-mode") == "navigate"
        if headers.get("sec-fetch-site", "none") not in ("none", "same-origin") and not follows_link:
            return "the request comes from a page of another site"
        if method == "POST" and not headers.get("content-type", "").startswith("application/json"):
            return "expected application/json"
        length = headers.get("content-length", "0")
        if "transfer-encoding" in headers or not (length.isascii() and length.isdigit()):
            return "Content-Length: expected a number of bytes"
        too_large = len(length) > MAX_LENGTH_DIGITS or int(length) > LARGEST_BODY_BYTES
        return "the request is too large" if too_large else ""

    def _is_own(self, origin: str) -> bool:
        return origin.lower() in {f"http://{host}" for host in self._hosts}


Body = TypeVar("Body", bound=Value)


async def posted(model: type[Body], request: Request) -> Body:
    """Parse the JSON body of a request; raises InputError if it is invalid.

    It is parsed in a thread, so that other requests are not delayed; `LocalAccess` limits the size of the body.
    """
    body = await request.body()
    return await run_in_threadpool(lambda: validated(model, json_value(body)))


def as_json(value: Any) -> Response:
    """Return a JSON response of values and dataclasses: NaN and infinity as null."""
    return Response(json_line(value), media_type="application/json")


def json_line(value: Any) -> bytes:
    """Convert values and dataclasses to JSON on one line: NaN and infinity as null."""
    return to_json(value, inf_nan_mode="null")


async def _refused(request: Request, error: Exception) -> Response:
    return PlainTextResponse(str(error), status_code=422)


REFUSALS: dict[type[Exception], HTTPExceptionHandler] = {InputError: _refused}
"""Responses to a bad request: one line of text."""


class ServedFiles(StaticFiles):
    """Serves the regular files below a folder, which need not exist yet; for anything else, the status is 404."""

    def __init__(self, folder: Path) -> None:
        super().__init__(directory=folder, check_dir=False)

    async def check_config(self) -> None:
        return

    async def get_response(self, path: str, scope: Scope) -> Response:
        """Return the response to a request; status 404 for an unreadable file."""
        try:
            return await super().get_response(path, scope)
        except OSError:  # for example, a link to itself
            raise HTTPException(404) from None
