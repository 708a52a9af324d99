"""What the live server answers: its page, pictures, the status, and orders."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import simplejpeg
from starlette.testclient import TestClient

from mirrorcam.optics.geometry.boards import save_board
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.studio.live.engine import LiveEngine
from mirrorcam.studio.live.server import live_app, plain
from mirrorcam.studio.live.values import LiveRequest
from tests.nightly import a_few
from tests.small_set import BOARD
from tests.studio.live.live_sets import repeated, write_live_set

PORT = 8611
JSON = {"content-type": "application/json"}
LONG_S = 60.0


@pytest.fixture(scope="module")
def engine(tmp_path_factory: pytest.TempPathFactory, default_layout: Layout) -> Iterator[LiveEngine]:
    folder = tmp_path_factory.mktemp("live_server")
    layout, video = write_live_set(folder, default_layout, frames=25)
    repeated(video, folder / "long.mkv", 120)
    save_board(folder / "board.toml", BOARD)
    request = LiveRequest(layout, str(folder / "long.mkv"), frame_width_px=240, view_width_px=100, depth_width_px=80)
    with LiveEngine(request, out=folder / "out", board=folder / "board.toml") as engine:
        yield engine


@pytest.fixture(scope="module")
def client(engine: LiveEngine) -> Iterator[TestClient]:
    with TestClient(live_app(engine, PORT), base_url=f"http://127.0.0.1:{PORT}") as opened:
        yield opened


def ordered(client: TestClient, action: str, **fields: Any) -> Any:
    return client.post("/order", content=json.dumps({"action": action, **fields}), headers=JSON)


def until(client: TestClient, key: str) -> Any:
    end = time.monotonic() + LONG_S
    while not (value := client.get("/status").json()[key]):
        assert time.monotonic() < end
        time.sleep(0.05)
    return value


def test_the_page_holds_all_that_it_needs(client: TestClient) -> None:
    answer = client.get("/")
    assert answer.status_code == 200 and "MirrorCam live" in answer.text
    assert "long.mkv" in answer.text and 'id="take"' in answer.text
    assert "http://" not in answer.text.replace("http://www.w3.org", "") and "https://" not in answer.text
    assert "default-src 'none'" in answer.headers["content-security-policy"]


@pytest.mark.parametrize("kind", a_few(2, ["frame", "views", "refocus", "depth"]))
def test_pictures_are_the_newest_beyond_a_number(client: TestClient, kind: str) -> None:
    serial = "0"
    for _ in range(2):
        end = time.monotonic() + LONG_S
        while (answer := client.get(f"/picture/{kind}?after={serial}")).status_code == 204:
            assert time.monotonic() < end
        assert answer.status_code == 200 and answer.headers["content-type"] == "image/jpeg"
        assert int(answer.headers["x-serial"]) > int(serial)
        assert simplejpeg.decode_jpeg(answer.content).ndim == 3
        serial = answer.headers["x-serial"]


@pytest.mark.parametrize(
    "path", ["/picture/none", "/picture/views?after=-1", "/picture/views?after=1e9", "/files/../x"]
)
def test_what_is_not_there_is_not_found(client: TestClient, path: str) -> None:
    assert client.get(path).status_code == 404


def test_depth_at_a_point(client: TestClient) -> None:
    until(client, "depth_hz")
    value = client.get("/depth?right=0.5&down=0.5").json()["depth_mm"]
    assert value is None or 200 < value < 1000
    assert client.get("/depth?right=2&down=0.5").json() == {"depth_mm": None}
    assert client.get("/depth?right=nan&down=0.5").json() == {"depth_mm": None}
    assert client.get("/depth").status_code == 422


def test_the_status_is_plain_json(client: TestClient) -> None:
    until(client, "frames")
    status = client.get("/status").json()
    assert status["failed"] is None and status["exposure"]["advice"] and len(status["sharpness"]) == 9
    assert plain({"a": (float("nan"), Path("b")), "c": [1, True, None]}) == {"a": [None, "b"], "c": [1, True, None]}


def test_orders_are_done_or_refused_in_one_line(client: TestClient, engine: LiveEngine) -> None:
    assert ordered(client, "focus", depth_mm=300.0).json() == {"path": None}
    assert ordered(client, "reset_focus").status_code == 200
    recording = Path(ordered(client, "record").json()["path"])
    until(client, "recording")
    assert ordered(client, "stop_recording").status_code == 200
    assert recording.parent == engine.out / "recordings"
    playing = ordered(client, "play_again")
    assert playing.status_code == 422 and "expected a source that has ended" in playing.text
    for wrong in ({"action": "explode"}, {"action": "focus"}, {"action": "focus", "depth_mm": -1.0}, {"on": True}):
        answer = client.post("/order", content=json.dumps(wrong), headers=JSON)
        assert answer.status_code == 422 and "\n" not in answer.text and answer.text
    assert client.post("/order", content="{", headers=JSON).status_code == 422


def test_a_calibration_picture_gets_its_hint(client: TestClient) -> None:
    taken = Path(ordered(client, "take_picture").json()["path"])
    hint = until(client, "hint")
    assert taken.is_file() and hint["sentence"].startswith("next: ")


def test_other_sites_are_refused(client: TestClient) -> None:
    other = {"origin": "http://elsewhere.example"}
    assert client.get("/status", headers=other).status_code == 403
    assert client.get("/status", headers={"host": "elsewhere.example"}).status_code == 403
