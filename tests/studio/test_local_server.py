"""The server on the loopback address: who may ask, what is refused, files that it serves, and its end."""

from __future__ import annotations

import asyncio
import os
import socket
import threading
import urllib.request
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
from anyio.from_thread import start_blocking_portal
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Mount, Route
from starlette.testclient import TestClient

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import Value
from mirrorcam.studio import local_server
from mirrorcam.studio.local_server import (
    LARGEST_BODY_BYTES,
    LOOPBACK,
    REFUSALS,
    LocalAccess,
    ServedFiles,
    listening_socket,
    posted,
    run_server,
)


def test_a_port_that_is_taken_is_refused_in_one_line() -> None:
    with listening_socket(0) as first:
        address, port = first.getsockname()
        assert address == LOOPBACK
        with pytest.raises(InputError, match=f"--port {port}: .*expected a free one"):
            listening_socket(port)


def test_without_a_port_the_next_free_one_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    with listening_socket(0) as first:
        taken = first.getsockname()[1]
        monkeypatch.setattr(local_server, "DEFAULT_PORT", taken)
        with listening_socket(None) as second:
            assert second.getsockname()[1] != taken


def test_it_serves_until_it_is_told_to_end(monkeypatch: pytest.MonkeyPatch) -> None:
    servers: list[local_server._Server] = []
    began, ended = threading.Event(), list[bool]()
    told: list[str] = []

    class Noted(local_server._Server):
        async def startup(self, sockets: object = None) -> None:
            servers.append(self)
            await super().startup(sockets)  # type: ignore[arg-type]
            began.set()

    monkeypatch.setattr(local_server, "_Server", Noted)
    app = Starlette(routes=[Route("/", lambda request: PlainTextResponse("here"))])
    with listening_socket(0) as listening:
        served = threading.Thread(
            target=run_server,
            args=(app, listening),
            kwargs={"browser": False, "on_note": told.append, "end": lambda: ended.append(True)},
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


PORT = 8610
OWN = f"http://127.0.0.1:{PORT}"


@pytest.fixture(scope="module")
def guarded() -> TestClient:
    async def echo(request: Request) -> Response:
        return PlainTextResponse(str(len(await request.body())))

    app = Starlette(
        routes=[Route("/", echo, methods=["GET", "POST"])],
        middleware=[Middleware(LocalAccess, port=PORT)],
    )
    return TestClient(app, base_url=OWN)


@pytest.mark.parametrize("host", [f"127.0.0.1:{PORT}", f"localhost:{PORT}", f"LOCALHOST:{PORT}", f"[::1]:{PORT}"])
def test_the_loopback_address_is_answered_by_each_of_its_names(guarded: TestClient, host: str) -> None:
    assert guarded.get("/", headers={"host": host}).status_code == 200


@pytest.mark.parametrize("host", ["evil.example", f"evil.example:{PORT}", "127.0.0.1", f"127.0.0.1:{PORT + 1}", ""])
def test_a_name_that_only_leads_here_is_refused(guarded: TestClient, host: str) -> None:
    assert guarded.get("/", headers={"host": host}).status_code == 403


@pytest.mark.parametrize(
    "headers",
    [
        {"origin": "http://evil.example"},
        {"origin": "null"},
        {"origin": "http://[bad"},
        {"origin": f"https://127.0.0.1:{PORT}"},
        {"origin": f"http://127.0.0.1:{PORT + 1}"},
        {"sec-fetch-site": "cross-site", "sec-fetch-mode": "no-cors"},
        {"sec-fetch-site": "same-site", "sec-fetch-mode": "cors"},
        {"sec-fetch-site": "cross-site", "sec-fetch-mode": "navigate"},
    ],
)
def test_a_page_of_another_site_may_not_ask(guarded: TestClient, headers: Mapping[str, str]) -> None:
    sent = {"content-type": "application/json"} | dict(headers)
    assert guarded.post("/", content=b"{}", headers=sent).status_code == 403


def test_a_link_from_another_site_may_lead_here(guarded: TestClient) -> None:
    headers = {"sec-fetch-site": "cross-site", "sec-fetch-mode": "navigate"}
    assert guarded.get("/", headers=headers).status_code == 200


def test_the_page_itself_may_ask(guarded: TestClient) -> None:
    headers = {"content-type": "application/json", "origin": OWN, "sec-fetch-site": "same-origin"}
    assert guarded.post("/", content=b"{}", headers=headers).text == "2"


def test_a_form_is_refused(guarded: TestClient) -> None:
    assert guarded.post("/", data={"a": "b"}).status_code == 403


def test_a_body_is_limited_whatever_length_it_states(guarded: TestClient) -> None:
    headers = {"content-type": "application/json"}
    assert guarded.post("/", content=b" " * (LARGEST_BODY_BYTES + 1), headers=headers).status_code == 403
    parts = (b" " * 100_000 for _ in range(LARGEST_BODY_BYTES // 100_000 + 1))
    assert guarded.post("/", content=parts, headers=headers).status_code == 403


def test_answers_let_the_browser_fetch_from_nowhere_else(guarded: TestClient) -> None:
    headers = [guarded.get("/").headers for _ in range(2)]
    policy = headers[0]["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert "http" not in policy
    assert policy != headers[1]["content-security-policy"]
    assert headers[0]["x-content-type-options"] == "nosniff"


class Wish(Value):
    """A body to post."""

    wished_rows: int


async def wished_rows(request: Request) -> Response:
    wish = await posted(Wish, request)
    return PlainTextResponse(str(wish.wished_rows))


@pytest.fixture
def asking() -> Iterator[TestClient]:
    app = Starlette(routes=[Route("/", wished_rows, methods=["POST"])], exception_handlers=REFUSALS)
    with TestClient(app) as opened:
        yield opened


@pytest.mark.parametrize(
    ("body", "status", "said"),
    [
        ('{"wished_rows": 3}', 200, "3"),
        ('{"wished_rows": "3"}', 422, "wished_rows"),
        ('{"wished_rows": 3, "cols": 3}', 422, "cols"),
        ("wished_rows", 422, "JSON"),
        ('{"wished_rows": 3, "wished_rows": 4}', 422, "twice"),
        ('{"wished_rows": ' + "[" * 100_000, 422, "nested deeper"),
        ('{"wished_rows": ' + "1" * 100_000 + "}", 422, "an integer of 100000 digits"),
    ],
)
def test_a_value_or_a_refusal_in_one_line(asking: TestClient, body: str, status: int, said: str) -> None:
    answer = asking.post("/", content=body)
    assert (answer.status_code, len(answer.text.splitlines())) == (status, 1)
    assert said in answer.text


def test_bodies_are_parsed_outside_the_event_loop(asking: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    def parsed(body: bytes) -> dict[str, int]:
        with pytest.raises(RuntimeError, match="no running event loop"):
            asyncio.get_running_loop()
        return {"wished_rows": 7}

    monkeypatch.setattr(local_server, "json_value", parsed)
    assert asking.post("/", content="{}").text == "7"


TEXT = "0123456789" * 20_000


@pytest.fixture
def serving(tmp_path: Path) -> TestClient:
    (tmp_path / "a.txt").write_text(TEXT)
    return TestClient(Starlette(routes=[Mount("/files", ServedFiles(tmp_path))]))


def test_files_and_parts_of_them_are_sent(serving: TestClient) -> None:
    assert serving.get("/files/a.txt").text == TEXT
    part = serving.get("/files/a.txt", headers={"range": "bytes=10-14"})
    assert part.status_code == 206 and part.text == "01234"
    parts = serving.get("/files/a.txt", headers={"range": "bytes=0-1,5-6"})
    assert parts.status_code == 206 and "01" in parts.text and "56" in parts.text
    head = serving.head("/files/a.txt")
    assert head.headers["content-length"] == str(len(TEXT)) and head.content == b""
    etag = head.headers["etag"]
    assert serving.get("/files/a.txt", headers={"if-none-match": etag}).status_code == 304


@pytest.mark.parametrize(
    ("name", "headers_given", "status"),
    [
        ("empty", {}, 200),
        ("empty", {"range": "bytes=0-"}, 416),
        ("a.txt", {}, 200),
        ("a.txt", {"range": "bytes=999999-"}, 416),
        ("a.txt", {"range": "bytes=b-a"}, 400),
        ("a.txt", {"range": "bytes=0-1,5-6"}, 206),
    ],
)
def test_every_answer_ends_once(name: str, headers_given: dict[str, str], status: int, tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text(TEXT)
    (tmp_path / "empty").touch()
    headers = [(key.encode(), value.encode()) for key, value in headers_given.items()]
    scope = {"type": "http", "asgi": {"spec_version": "2.4"}, "method": "GET", "path": f"/{name}", "headers": headers}
    sent: list[Any] = []

    async def receive() -> Any:
        raise AssertionError("no body is expected")

    async def send(message: Any) -> None:
        sent.append(message)

    # In a thread of its own: a browser that other tests keep open has an event loop in this one.
    with start_blocking_portal() as portal:
        portal.call(ServedFiles(tmp_path), scope, receive, send)
    assert sent[0]["status"] == status
    assert [each.get("more_body", False) for each in sent[1:]] == [True] * (len(sent) - 2) + [False]


@pytest.mark.parametrize(
    "make", [os.mkfifo, os.mkdir, lambda path: path.symlink_to(path)], ids=["fifo", "folder", "loop"]
)
def test_what_is_no_file_is_not_found(make: Callable[[Path], None], serving: TestClient, tmp_path: Path) -> None:
    make(tmp_path / "odd")
    assert serving.get("/files/odd").status_code == 404
    assert serving.get("/files/odd/inside").status_code == 404
    assert serving.get("/files/a.txt/inside").status_code == 404


def test_there_are_no_files_without_their_folder(tmp_path: Path) -> None:
    serving = TestClient(Starlette(routes=[Mount("/files", ServedFiles(tmp_path / "none"))]))
    assert serving.get("/files/a.txt").status_code == 404
