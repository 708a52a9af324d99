"""What a page asks is checked strictly, and what is refused is answered in one line."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator

import pytest
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route
from starlette.testclient import TestClient

from mirrorcam.core.values import Value
from mirrorcam.studio import page_requests
from mirrorcam.studio.local_access import BodyTooLarge
from mirrorcam.studio.page_requests import REFUSALS, asked


class Wish(Value):
    """What is asked for here."""

    rows: int


async def rows(request: Request) -> Response:
    wish = await asked(Wish, request)
    if wish.rows > 100:
        raise BodyTooLarge("too large")
    return PlainTextResponse(str(wish.rows))


@pytest.fixture
def client() -> Iterator[TestClient]:
    app = Starlette(routes=[Route("/", rows, methods=["POST"])], exception_handlers=REFUSALS)
    with TestClient(app) as opened:
        yield opened


@pytest.mark.parametrize(
    ("body", "status", "said"),
    [
        ('{"rows": 3}', 200, "3"),
        ('{"rows": "3"}', 422, "rows"),
        ('{"rows": 3, "cols": 3}', 422, "cols"),
        ("rows", 422, "JSON"),
        ('{"rows": 3, "rows": 4}', 422, "twice"),
        ('{"rows": ' + "[" * 100_000, 422, "nested deeper"),
        ('{"rows": ' + "1" * 100_000 + "}", 422, "an integer of 100000 digits"),
        ('{"rows": 101}', 413, "too large"),
    ],
)
def test_a_value_or_a_refusal_in_one_line(client: TestClient, body: str, status: int, said: str) -> None:
    answer = client.post("/", content=body)
    assert (answer.status_code, len(answer.text.splitlines())) == (status, 1)
    assert said in answer.text


def test_bodies_are_parsed_beside_the_event_loop(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    def parsed(body: bytes) -> dict[str, int]:
        with pytest.raises(RuntimeError, match="no running event loop"):
            asyncio.get_running_loop()
        return {"rows": 7}

    monkeypatch.setattr(page_requests, "json_value", parsed)
    assert client.post("/", content="{}").text == "7"
