"""Serving an application on the loopback address until Ctrl-C."""

from __future__ import annotations

import socket
import webbrowser
from collections.abc import Callable

import uvicorn
from starlette.applications import Starlette
from uvicorn.protocols.http.h11_impl import H11Protocol

from mirrorcam.core.values import InputError

LOOPBACK = "127.0.0.1"
ENDING_S = 2
"""Time that answers which are under way have at the end."""


class _Protocol(H11Protocol):
    """HTTP of one connection. What is no HTTP ends it without a further answer; one that has begun breaks off.

    Without this, uvicorn answers 400 in the middle of another answer, or the application answers after the 400.
    """

    def send_400_response(self, msg: str) -> None:
        begun = self.cycle is not None and self.cycle.response_started
        if self.cycle is not None:
            self.cycle.disconnected = True
            self.cycle.message_event.set()
        if begun:
            self.transport.close()
        else:
            super().send_400_response(msg)


class _Server(uvicorn.Server):
    """A server that ends what it waits for before it waits."""

    def __init__(self, config: uvicorn.Config, end: Callable[[], None]) -> None:
        super().__init__(config)
        self._end = end

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        self._end()
        await super().shutdown(sockets)


def listening_socket(port: int) -> socket.socket:
    """A socket on the loopback address, at any free port for 0. Raises InputError for one that is taken."""
    # With the protocol stated, asyncio sends at once; else the body of an answer waits 40 ms for its head to arrive.
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((LOOPBACK, port))
        listening.listen()
    except OSError as error:
        listening.close()
        raise InputError(f"--port {port}: {error.strerror}, expected a free one, or 0 for any") from None
    return listening


def run_server(
    app: Starlette,
    listening: socket.socket,
    *,
    browser: bool,
    tell: Callable[[str], None],
    end: Callable[[], None],
) -> None:
    """Serve until Ctrl-C; `end` is called once no more is asked, before answers that are under way are waited for."""
    address = f"http://{LOOPBACK}:{listening.getsockname()[1]}/"
    config = uvicorn.Config(
        app, http=_Protocol, ws="none", log_level="error", timeout_graceful_shutdown=ENDING_S, server_header=False
    )
    tell(f"{address} (Ctrl-C ends it)")
    if browser:
        webbrowser.open(address)
    try:
        _Server(config, end).run(sockets=[listening])
    except KeyboardInterrupt:  # of uvicorn, which has ended by then
        tell("ended")
