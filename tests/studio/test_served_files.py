"""Files that change while they are sent, or cannot be read."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from anyio.from_thread import start_blocking_portal
from starlette.applications import Starlette
from starlette.routing import Mount
from starlette.testclient import TestClient

from mirrorcam.studio.served_files import ServedFiles, _SentFile

TEXT = "0123456789" * 20_000


@pytest.fixture
def client(tmp_path: Path) -> TestClient:
    (tmp_path / "a.txt").write_text(TEXT)
    return TestClient(Starlette(routes=[Mount("/files", ServedFiles(tmp_path))]))


def test_files_and_parts_of_them_are_sent(client: TestClient) -> None:
    assert client.get("/files/a.txt").text == TEXT
    part = client.get("/files/a.txt", headers={"range": "bytes=10-14"})
    assert part.status_code == 206 and part.text == "01234"
    parts = client.get("/files/a.txt", headers={"range": "bytes=0-1,5-6"})
    assert parts.status_code == 206 and "01" in parts.text and "56" in parts.text
    head = client.head("/files/a.txt")
    assert head.headers["content-length"] == str(len(TEXT)) and head.content == b""
    etag = head.headers["etag"]
    assert client.get("/files/a.txt", headers={"if-none-match": etag}).status_code == 304


@pytest.mark.parametrize(
    ("name", "asked", "status"),
    [
        ("empty", {}, 200),
        ("empty", {"range": "bytes=0-"}, 416),
        ("a.txt", {}, 200),
        ("a.txt", {"range": "bytes=999999-"}, 416),
        ("a.txt", {"range": "bytes=b-a"}, 400),
        ("a.txt", {"range": "bytes=0-1,5-6"}, 206),
    ],
)
def test_every_answer_ends_once(name: str, asked: dict[str, str], status: int, tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text(TEXT)
    (tmp_path / "empty").touch()
    headers = [(key.encode(), value.encode()) for key, value in asked.items()]
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
def test_what_is_no_file_is_not_found(make: Callable[[Path], None], client: TestClient, tmp_path: Path) -> None:
    make(tmp_path / "odd")
    assert client.get("/files/odd").status_code == 404
    assert client.get("/files/odd/inside").status_code == 404
    assert client.get("/files/a.txt/inside").status_code == 404


def test_there_are_no_files_without_their_folder(tmp_path: Path) -> None:
    client = TestClient(Starlette(routes=[Mount("/files", ServedFiles(tmp_path / "none"))]))
    assert client.get("/files/a.txt").status_code == 404


@pytest.mark.parametrize("change", [lambda path: path.unlink(), lambda path: path.write_text("short"), None])
def test_a_file_that_changes_meanwhile_is_never_longer_than_stated(
    change: Callable[[Path], Any] | None, client: TestClient, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """None: it grows. The answer has begun when it changes; it breaks off, and nothing is raised."""
    path, original = tmp_path / "a.txt", _SentFile._handle_simple

    async def late(self: _SentFile, *arguments: Any) -> None:
        if change is None:
            path.write_text(TEXT + TEXT)
        else:
            change(path)
        await original(self, *arguments)

    monkeypatch.setattr(_SentFile, "_handle_simple", late)
    answer = client.get("/files/a.txt")
    assert answer.headers["content-length"] == str(len(TEXT))
    assert (answer.text == TEXT) if change is None else len(answer.text) < len(TEXT)
