"""A server on the loopback address: its port, and its end."""

from __future__ import annotations

import socket
import threading
import urllib.request

import pytest
from starlette.applications import Starlette
from starlette.responses import PlainTextResponse
from starlette.routing import Route

from mirrorcam.core.values import InputError
from mirrorcam.studio import loopback
from mirrorcam.studio.loopback import LOOPBACK, listening_socket, run_server


def test_a_port_that_is_taken_is_refused_in_one_line() -> None:
    with listening_socket(0) as first:
        address, port = first.getsockname()
        assert address == LOOPBACK
        with pytest.raises(InputError, match=f"--port {port}: .*expected a free one"):
            listening_socket(port)


def test_it_serves_until_it_is_told_to_end(monkeypatch: pytest.MonkeyPatch) -> None:
    servers: list[loopback._Server] = []
    began, ended = threading.Event(), list[bool]()
    told: list[str] = []

    class Noted(loopback._Server):
        async def startup(self, sockets: object = None) -> None:
            servers.append(self)
            await super().startup(sockets)  # type: ignore[arg-type]
            began.set()

    monkeypatch.setattr(loopback, "_Server", Noted)
    app = Starlette(routes=[Route("/", lambda request: PlainTextResponse("here"))])
    with listening_socket(0) as listening:
        served = threading.Thread(
            target=run_server,
            args=(app, listening),
            kwargs={"browser": False, "tell": told.append, "end": lambda: ended.append(True)},
        )
        served.start()
        assert began.wait(20.0)
        address = told[0].split()[0]
        with urllib.request.urlopen(address) as answer:
            assert answer.read() == b"here"
        assert not ended
        servers[0].should_exit = True
        served.join(20.0)
    assert ended == [True] and not served.is_alive()


def test_answers_are_sent_at_once() -> None:
    with listening_socket(0) as listening, socket.create_connection(listening.getsockname()) as asking:
        accepted, _ = listening.accept()
        with accepted:
            # What asyncio looks at before it switches the delay of small packets off.
            assert accepted.proto == socket.IPPROTO_TCP
            assert asking.getpeername() == listening.getsockname()
