"""Only the page itself and programs of this machine are answered, and its page can fetch from nowhere else."""

from __future__ import annotations

from collections.abc import Mapping

import pytest
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route
from starlette.testclient import TestClient

from mirrorcam.studio.local_access import LARGEST_BODY_BYTES, BodyTooLarge, LocalAccess

PORT = 8610
OWN = f"http://127.0.0.1:{PORT}"


@pytest.fixture(scope="module")
def client() -> TestClient:
    async def echo(request: Request) -> Response:
        return PlainTextResponse(str(len(await request.body())))

    async def too_large(request: Request, error: Exception) -> Response:
        return PlainTextResponse(str(error), status_code=413)

    app = Starlette(
        routes=[Route("/", echo, methods=["GET", "POST"])],
        middleware=[Middleware(LocalAccess, port=PORT)],
        exception_handlers={BodyTooLarge: too_large},
    )
    return TestClient(app, base_url=OWN)


@pytest.mark.parametrize("host", [f"127.0.0.1:{PORT}", f"localhost:{PORT}", f"LOCALHOST:{PORT}", f"[::1]:{PORT}"])
def test_the_loopback_address_is_answered_by_each_of_its_names(client: TestClient, host: str) -> None:
    assert client.get("/", headers={"host": host}).status_code == 200


@pytest.mark.parametrize("host", ["evil.example", f"evil.example:{PORT}", "127.0.0.1", f"127.0.0.1:{PORT + 1}", ""])
def test_a_name_that_only_leads_here_is_refused(client: TestClient, host: str) -> None:
    assert client.get("/", headers={"host": host}).status_code == 403


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
def test_a_page_of_another_site_may_not_ask(client: TestClient, headers: Mapping[str, str]) -> None:
    sent = {"content-type": "application/json"} | dict(headers)
    assert client.post("/", content=b"{}", headers=sent).status_code == 403


def test_a_link_from_another_site_may_lead_here(client: TestClient) -> None:
    headers = {"sec-fetch-site": "cross-site", "sec-fetch-mode": "navigate"}
    assert client.get("/", headers=headers).status_code == 200


def test_the_page_itself_may_ask(client: TestClient) -> None:
    headers = {"content-type": "application/json", "origin": OWN, "sec-fetch-site": "same-origin"}
    assert client.post("/", content=b"{}", headers=headers).text == "2"


def test_a_form_is_refused(client: TestClient) -> None:
    assert client.post("/", data={"a": "b"}).status_code == 403


def test_a_body_is_limited_whatever_length_it_states(client: TestClient) -> None:
    headers = {"content-type": "application/json"}
    assert client.post("/", content=b" " * (LARGEST_BODY_BYTES + 1), headers=headers).status_code == 403
    parts = (b" " * 100_000 for _ in range(LARGEST_BODY_BYTES // 100_000 + 1))
    assert client.post("/", content=parts, headers=headers).status_code == 413


def test_answers_let_the_browser_fetch_from_nowhere_else(client: TestClient) -> None:
    headers = [client.get("/").headers for _ in range(2)]
    policy = headers[0]["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert "http" not in policy
    assert policy != headers[1]["content-security-policy"]
    assert headers[0]["x-content-type-options"] == "nosniff"
