"""What the studio's server answers: designs, refusals, files of its folder and nothing beside it."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from http.client import HTTPConnection
from pathlib import Path
from typing import Any

import pytest
from starlette.testclient import TestClient

from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.studio.designer import Designer
from mirrorcam.studio.jobs import Jobs
from mirrorcam.studio.live.answers import CameraHost
from mirrorcam.studio.server import studio_app

PORT = 8610
SMALL = DesignSpec(rows=1, cols=2, depths_mm=(300.0,))
JSON = {"content-type": "application/json"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("root")
    (root / "studio" / "some").mkdir(parents=True)
    (root / "studio" / "some" / "file.txt").write_text("inside")
    (root / "secret.txt").write_text("outside")
    (root / "studio" / "some" / "way-out").symlink_to(root)
    return root / "studio"


@pytest.fixture(scope="module")
def client(folder: Path) -> Iterator[TestClient]:
    designer = Designer()
    jobs = Jobs(folder)
    app = studio_app(DesignSpec(), designer, jobs, CameraHost(jobs), PORT)
    with TestClient(app, base_url=f"http://127.0.0.1:{PORT}") as opened:
        yield opened
    designer.close()


def lines(text: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in text.splitlines()]


def test_a_request_gives_its_exact_design_and_the_files_of_it(client: TestClient) -> None:
    body = SMALL.model_dump_json()
    assert client.post("/layout", content=body, headers=JSON).status_code == 422
    *steps, found = lines(client.post("/design", content=body, headers=JSON).text)
    shares = [step["progress"] for step in steps]
    assert shares == sorted(shares) and (shares[0], shares[-1]) == (0.0, 1.0)
    assert lines(client.post("/design", content=body, headers=JSON).text) == [found]  # it is kept
    assert found["status"] == "solved"
    assert found["drawing"]["kind"] == "exact"
    layout = Layout.model_validate_json(client.post("/layout", content=body, headers=JSON).text)
    assert layout.identity == found["drawing"]["identity"]
    assert layout.spec == SMALL
    text = client.post("/request", content=body, headers=JSON).text
    opened = client.post("/opened", content=json.dumps({"name": "design.toml", "text": text}), headers=JSON).json()
    assert DesignSpec.model_validate_json(json.dumps(opened)) == SMALL


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        (b"{", "JSON"),
        (b'{"rows": "three"}', "rows"),
        (b'{"rows": 3, "colour": 1}', "colour: not known"),
        (b'{"depths_mm": []}', "depths_mm"),
        (b'{"scale_mm": 1e999}', "scale_mm"),
    ],
)
def test_invalid_requests_are_refused_in_one_line(client: TestClient, body: bytes, expected: str) -> None:
    (found,) = lines(client.post("/design", content=body, headers=JSON).text)
    assert found["status"] == "refused"
    assert expected in found["finding"]
    assert "\n" not in found["finding"]
    answer = client.post("/preview", content=body, headers=JSON)
    assert answer.status_code == 422
    assert expected in answer.text


def test_a_request_reads_no_file_of_this_machine(client: TestClient, tmp_path: Path) -> None:
    own = tmp_path / "own.json"
    own.write_text(DesignSpec().camera.replaced(name="secret camera").model_dump_json())
    asked = {"design": {"camera": str(own)}, "opened": {"name": "design.toml", "text": f"camera = '{own}'"}}
    for route, body in asked.items():
        answer = client.post(f"/{route}", content=json.dumps(body), headers=JSON).text
        assert "expected one of" in answer
        assert "secret" not in answer


def test_files_in_the_folder_are_served_and_none_outside(client: TestClient) -> None:
    assert client.get("/files/some/file.txt").text == "inside"
    for path in (
        *("/files/../secret.txt", "/files/%2e%2e/secret.txt", "/files/some/../../secret.txt"),
        *("/files/some/way-out/secret.txt", "/files//etc/passwd", "/files/some%2f..%2f..%2fsecret.txt"),
        *("/zip/%2e%2e", "/zip/../secret.txt", "/zip/some/way-out", "/zip/%2e%2e/x", "/files/"),
    ):
        answer = client.get(path)
        assert answer.status_code in (404, 405, 422), path
        assert "outside" not in answer.text


def test_there_are_no_files_before_the_first_job(tmp_path: Path) -> None:
    designer = Designer()
    jobs = Jobs(tmp_path / "none")
    app = studio_app(DesignSpec(), designer, jobs, CameraHost(jobs), PORT)
    with TestClient(app, base_url=f"http://127.0.0.1:{PORT}") as client:
        assert client.get("/files/anything").status_code == 404
    designer.close()


def test_a_picture_is_not_a_design(client: TestClient) -> None:
    answer = client.post("/opened", content=json.dumps({"name": "a.jpg", "text": "x"}), headers=JSON)
    assert (answer.status_code, answer.text) == (422, "a.jpg: expected a design.toml or a layout.json")


def test_only_what_was_solved_is_made(client: TestClient) -> None:
    body = json.dumps({"kind": "parts", "spec": {"rows": 2, "cols": 2}})
    assert client.post("/jobs", content=body, headers=JSON).status_code == 422
    body = json.dumps({"kind": "rm -rf", "spec": json.loads(SMALL.model_dump_json())})
    assert client.post("/jobs", content=body, headers=JSON).status_code == 422
    assert client.get("/state").json() == {"jobs": [], "camera": None}
    assert client.post("/jobs/7/cancel", content=b"{}", headers=JSON).status_code == 422
    for number in ("9" * 5000, "-1", "1.0", "%D9%A1"):
        assert client.post(f"/jobs/{number}/cancel", content=b"{}", headers=JSON).status_code == 404


def test_a_camera_that_is_not_open_or_cannot_be_opened_is_refused_in_one_line(client: TestClient) -> None:
    assert client.get("/camera").json() == {"session": None, "layouts": []}
    order = client.post("/order", content='{"action": "record"}', headers=JSON)
    assert (order.status_code, client.get("/picture/frame").status_code) == (422, 422)
    assert order.text.startswith("no camera is open")
    opened = client.post("/camera", content='{"source": "none.mp4", "layout": "none.json"}', headers=JSON)
    assert (opened.status_code, opened.text) == (422, "none.json: no such file")


def test_nearby_are_the_solved_designs_for_the_same_camera_and_depths(client: TestClient, tmp_path: Path) -> None:
    others = {"rows": 2}, {"depths_mm": (400.0,)}
    for spec in (SMALL, *(SMALL.replaced(**other) for other in others)):
        client.post("/design", content=spec.model_dump_json(), headers=JSON)
    nearby = client.post(
        "/nearby", json={"spec": SMALL.model_dump(mode="json"), "terms": "70EUR 999h"}, headers=JSON
    ).json()
    points = {json.dumps(point["changes"]): point for point in nearby["points"]}
    assert points['{"rows": 2}']["step"] == "rows" and points["{}"]["step"] == ""
    assert not any("depths_mm" in point["changes"] for point in nearby["points"])
    assert points["{}"]["misses"] == ["price"]
    values = points["{}"]["values"]
    assert values["depth_sigma"] > points['{"rows": 2}']["values"]["depth_sigma"] > 0
    assert 50 < values["device_price"] < 300


def post(address: str, spec: DesignSpec, page: str | None) -> HTTPConnection:
    """A request for a design, whose answer is awaited later."""
    connection = HTTPConnection(address.split("/")[2], timeout=120.0)
    connection.request("POST", "/design", spec.model_dump_json(), JSON | ({} if page is None else {"x-page": page}))
    return connection


@pytest.mark.slow
def test_ten_pages_get_each_its_design_and_one_that_is_closed_is_not_waited_for(studio: tuple[str, Path]) -> None:
    closed = post(studio[0], DesignSpec(rows=6, cols=6), None)
    time.sleep(1.0)
    specs = [SMALL.replaced(scale_mm=90.0 + number) for number in range(10)]
    earlier = post(studio[0], SMALL.replaced(scale_mm=200.0), "page 0")
    pages = [post(studio[0], spec, f"page {number}" if number % 2 == 0 else None) for number, spec in enumerate(specs)]
    closed.close()
    for spec, page in zip(specs, pages, strict=True):
        found = lines(page.getresponse().read().decode())[-1]
        assert (
            found["status"] == "solved" and DesignSpec.model_validate_json(json.dumps(found["drawing"]["spec"])) == spec
        )
    ended = lines(earlier.getresponse().read().decode())  # superseded, unless it was first
    assert all("progress" in line or line["status"] == "solved" for line in ended)
