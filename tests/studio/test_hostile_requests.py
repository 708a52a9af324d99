"""Requests of any kind: never status 500, never a traceback in the terminal."""

from __future__ import annotations

import os
import random
import socket
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from mirrorcam.optics.geometry.layout import Layout
from tests.studio.browser import served
from tests.studio.live.live_sets import write_live_set

LONG = 5000
PIECES = [
    *(
        b"..",
        b".",
        b"",
        b"%00",
        b"a%00b",
        b"a" * 300,
        b"a" * LONG,
        b"%ff%fe",
        b"%ed%a0%80",
        b"\xff",
        b"%2e%2e",
        b"C:%5cx",
    ),
    *(b"9" * LONG, b"-1", b"0", b"1", b"%D9%A1", b"%C2%B2", b"1e999", b"con", b"sub", b"fifo", b"loop", b"f.txt"),
]
ROUTES = [
    *(b"", b"files", b"files/sub", b"jobs", b"jobs/1/cancel", b"zip", b"preview", b"design", b"suggestions", b"steps"),
    *(b"tolerance", b"frame", b"decoded", b"refocused", b"report", b"layout", b"request", b"opened", b"state"),
    *(b"camera", b"picture", b"picture/depth", b"depth", b"order", b"calibrate"),
]
METHODS = [b"GET", b"HEAD", b"POST", b"PUT", b"DELETE", b"OPTIONS", b"TRACE", b"FOO"]
QUERIES = [b"", b"?", b"?after=9&after=x", b"?right=nan&down=1e999", b"?after=" + b"9" * LONG, b"?right=%00&down=\xff"]
BODIES = [
    *(b"", b"{", b"null", b"[]", b"9" * LONG, b"[" * 20_000, b"\xff\xfe", b'{"rows":' + b"9" * LONG + b"}"),
    *(b'{"action":"focus","depth_mm":1e999}', b'{"action":"calibrate"}', b'{"action":"take_picture"}'),
    *(b'{"name":"\\u0000","text":"\\ud800"}', b'{"name":"..","text":"a=1"}', b'{"kind":"parts","spec":{"rows":1}}'),
]
HEADERS = [
    (b"Range", b"bytes=-"),
    (b"Range", b"bytes=5-2"),
    (b"Range", b"bytes=999999-"),
    (b"Range", b"bytes=" + b"9" * LONG + b"-"),
    (b"Range", b"bytes=\xb2-\xb3"),
    (b"Range", b"bytes=" + b"0-1," * 3000),
    (b"If-Range", b"\xff"),
    (b"If-Modified-Since", b"1 Jan " + b"9" * LONG),
    (b"If-None-Match", b"\xff,,"),
    (b"Origin", b"\xff"),
    (b"X-Page", b"\xff" * 100),
    (b"Sec-Fetch-Site", b"\xff"),
    (b"X-Nothing", b""),
]


def request(port: int, method: bytes, path: bytes, headers: list[tuple[bytes, bytes]], body: bytes) -> bytes:
    lines = [b"Host: 127.0.0.1:%d" % port, b"Connection: close", b"Content-Length: %d" % len(body)]
    lines += [name + b": " + value for name, value in headers]
    return b"\r\n".join([method + b" " + path + b" HTTP/1.1", *lines, b"", body])


def status(port: int, sent: bytes) -> int:
    """The status of the answer."""
    with socket.create_connection(("127.0.0.1", port), timeout=60.0) as connection:
        connection.sendall(sent)
        head = connection.recv(12)
    return int(head.split()[1])


@pytest.fixture
def server(tmp_path: Path, default_layout: Layout) -> Iterator[tuple[int, Path]]:
    """The port of a server with a camera, and what it has written to the terminal."""
    out, errors = tmp_path / "out", tmp_path / "errors.txt"
    (out / "sub").mkdir(parents=True)
    (out / "sub" / "f.txt").write_text("inside" * 1000)
    os.mkfifo(out / "fifo")
    (out / "loop").symlink_to(out / "loop")
    layout, video = write_live_set(tmp_path, default_layout, frames=3)
    with served(out, "live", str(video), "--layout", str(layout), errors=errors) as address:
        yield int(address.split("/")[2].rsplit(":", 1)[1]), errors


@pytest.mark.slow
def test_no_request_makes_a_server_fail(server: tuple[int, Path]) -> None:
    port, errors = server
    draw = random.Random(1)
    json = (b"Content-Type", b"application/json")
    sent = [
        request(port, method, b"/" + route + b"/" + piece, [json], b"")
        for route in ROUTES
        for piece in PIECES
        for method in draw.sample(METHODS, 2)
    ]
    sent += [
        request(port, b"POST", b"/" + route + draw.choice(QUERIES), [json, draw.choice(HEADERS)], body)
        for route in ROUTES
        for body in BODIES
    ]
    sent += [request(port, b"GET", b"/files/sub/f.txt", [header], b"") for header in HEADERS]
    sent += [request(port, b"GET", b"/" + route + query, [], b"") for route in ROUTES for query in QUERIES]
    sent += [request(port, b"POST", b"/jobs/" + piece + b"/cancel", [json], b"{}") for piece in PIECES]
    failed = [each[:100] for each in sent if status(port, each) >= 500]
    assert failed == []
    gone = 0
    for route in ROUTES:  # who goes away in the middle of a request, or of its answer
        for body in (b"{}", b'{"rows":1,"cols":2}', b'{"action":"focus","depth_mm":400}'):
            whole = request(port, b"POST", b"/" + route, [json], body)
            for part in (whole, whole[:-1], request(port, b"GET", b"/" + route, [], b"")):
                with socket.create_connection(("127.0.0.1", port)) as connection:
                    connection.sendall(part)
                gone += 1
    chunked = [(b"Content-Type", b"application/json"), (b"Transfer-Encoding", b"chunked")]
    for route in ROUTES:  # what is no HTTP any more, at once or while the answer is made or sent
        for method, headers, broken in ((b"POST", chunked, b"ZZ\r\n"), (b"GET", [], b"\x00\x01\r\n\r\n")):
            begun = request(port, method, b"/" + route, headers, b"").replace(b"Connection: close\r\n", b"")
            for delay_s in (None, 0.0, 0.01):
                with socket.create_connection(("127.0.0.1", port)) as connection:
                    connection.sendall(begun if delay_s is not None else begun + broken)
                    if delay_s is not None:
                        time.sleep(delay_s)
                        connection.sendall(broken)
                    connection.settimeout(0.05)
                    with suppress(TimeoutError):
                        connection.recv(12)
                gone += 1
    time.sleep(1.0)
    assert status(port, request(port, b"GET", b"/", [], b"")) == 200
    lines = errors.read_text(encoding="utf-8").splitlines()
    assert [line for line in lines if "Traceback" in line or "ASGI" in line] == []
    assert len(lines) <= len(sent) + gone
