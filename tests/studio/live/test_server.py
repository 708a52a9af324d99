"""What the server answers about the camera: its session, pictures, state, orders and calibration."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import simplejpeg
from starlette.testclient import TestClient

from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import pictures_in, read_image, write_image
from mirrorcam.optics.calibration.diagnostics.verdict import MIN_FRAMES
from mirrorcam.optics.geometry.boards import save_board
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.sets.render_set import render_set
from mirrorcam.render_scenes.sets.set_request import SetRequest
from mirrorcam.render_scenes.settings import RenderSettings
from mirrorcam.studio.designer import Designer
from mirrorcam.studio.jobs import Jobs
from mirrorcam.studio.live.answers import CameraHost
from mirrorcam.studio.live.values import LiveRequest
from mirrorcam.studio.local_server import json_line
from mirrorcam.studio.server import studio_app
from tests.nightly import a_few
from tests.shared import built_once
from tests.small_set import BOARD
from tests.studio.live.live_sets import repeated, write_live_set

PORT = 8611
JSON = {"content-type": "application/json"}
LONG_S = 60.0


@pytest.fixture(scope="module")
def host(tmp_path_factory: pytest.TempPathFactory, default_layout: Layout) -> Iterator[CameraHost]:
    folder = tmp_path_factory.mktemp("live_server")
    layout, video = write_live_set(folder, default_layout, frames=25)
    repeated(video, folder / "long.mkv", 120)
    save_board(folder / "board.toml", BOARD)
    request = LiveRequest(layout, str(folder / "long.mkv"), frame_width_px=240, view_width_px=100, depth_width_px=80)
    jobs = Jobs(folder / "out")
    opened = CameraHost(jobs)
    opened.open(request, folder / "board.toml").begin()
    yield opened
    opened.close()
    jobs.close()


@pytest.fixture(scope="module")
def client(host: CameraHost) -> Iterator[TestClient]:
    app = studio_app(DesignSpec(), Designer(), host.jobs, host, PORT)
    with TestClient(app, base_url=f"http://127.0.0.1:{PORT}") as opened:
        yield opened


def ordered(client: TestClient, action: str, **fields: Any) -> Any:
    return client.post("/order", content=json.dumps({"action": action, **fields}), headers=JSON)


def until(client: TestClient, key: str) -> Any:
    """A value of the camera's state, once a page that looks at its depth has it."""
    end = time.monotonic() + LONG_S
    while not (value := client.get("/state").json()["camera"][key]):
        assert time.monotonic() < end
        client.get("/picture/depth")
    return value


def test_the_page_holds_all_that_it_needs(client: TestClient) -> None:
    answer = client.get("/")
    assert answer.status_code == 200 and 'id="take"' in answer.text
    assert "http://" not in answer.text.replace("http://www.w3.org", "") and "https://" not in answer.text
    assert "default-src 'none'" in answer.headers["content-security-policy"]
    found = client.get("/camera").json()
    assert found["session"]["about"]["source"] == "long.mkv" and len(found["session"]["outlines"]) == 9
    assert found["layouts"][0].endswith("layout.json")


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
    status = client.get("/state").json()["camera"]
    assert status["failed"] is None and status["exposure"]["advice"] and len(status["sharpness"]) == 9
    assert json_line({"a": (float("nan"), Path("b")), "c": [1, True, None]}) == b'{"a":[null,"b"],"c":[1,true,null]}'


def test_orders_are_done_or_refused_in_one_line(client: TestClient, host: CameraHost) -> None:
    assert ordered(client, "focus", depth_mm=300.0).json() == {"path": None}
    assert ordered(client, "reset_focus").status_code == 200
    recording = Path(ordered(client, "record").json()["path"])
    until(client, "recording")
    assert ordered(client, "stop_recording").status_code == 200
    assert recording.parent == host.jobs.root / "recordings"
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
    assert client.get("/state", headers=other).status_code == 403
    assert client.get("/state", headers={"host": "elsewhere.example"}).status_code == 403


@pytest.fixture(scope="module")
def whole_set(default_layout: Layout, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A set that a calibration can be made of: ten frames of 640 x 360 pixels."""
    full = default_layout.camera
    focal = {"fx_px": full.fx_px / 3.0, "fy_px": full.fy_px / 3.0}
    layout = default_layout.replaced(camera=Camera(width_px=640, height_px=360, cx_px=319.5, cy_px=179.5, **focal))
    settings = RenderSettings(renderer="fast", maps=False)
    request = SetRequest(layout=layout, board=BOARD, frames=10, base_frames=0, seed=5, settings=settings)
    return built_once(tmp_path_factory, "live_calibration_set", lambda out: render_set(request, out))


@pytest.mark.slow
def test_the_pictures_taken_are_calibrated_by_a_job(whole_set: Path, tmp_path: Path) -> None:
    jobs = Jobs(tmp_path)
    host = CameraHost(jobs)
    host.open(LiveRequest(whole_set / "layout.json", str(whole_set / "frames")), whole_set / "board.toml")
    try:
        (tmp_path / "pictures").mkdir()
        frames = pictures_in([whole_set / "frames"])
        for number, path in enumerate(frames, 1):
            if number == MIN_FRAMES:
                with pytest.raises(InputError, match=rf"number of calibration pictures is 4, expected {MIN_FRAMES}"):
                    host.calibrate()
            write_image(tmp_path / "pictures" / f"picture_{number:04}.png", read_image(path))
        host.calibrate()
        with pytest.raises(InputError, match="running already"):
            host.calibrate()
        end = time.monotonic() + 2 * LONG_S
        while (report := jobs.reports()[0]).state == "running":
            assert time.monotonic() < end
            time.sleep(0.1)
        assert report.state in ("done", "alarm"), report.lines
        assert report.page == "calibrations/calibration_0001/report.html"
        assert host.layouts[-1].endswith("calibration_0001/layout.json")
    finally:
        host.close()
        jobs.close()
