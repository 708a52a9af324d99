"""What rerun's viewer is given, read back from a file that it could open; no window is opened."""

from __future__ import annotations

import socket
import sys
from typing import Any

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.optics.light_field.depth.depth_map import DepthMap
from mirrorcam.optics.light_field.io.ros_messages import depth_m
from mirrorcam.optics.light_field.light_field import LightField
from mirrorcam.robot import rerun_viewer
from mirrorcam.robot.rerun_viewer import DEPTH, SCENE, TIME, RerunViewer
from tests.optics.light_field.io.formats.test_registry import noise

rerun = pytest.importorskip("rerun", reason="needs rerun-sdk, of the extra view")
TIMES_S = (0.0, 0.04)


@pytest.fixture(scope="module")
def light_fields() -> list[LightField]:
    first = noise(3, 3)
    return [first, LightField.of(first, 255 - first.samples, first.weights)]


@pytest.fixture(scope="module")
def depth(light_fields: list[LightField]) -> DepthMap:
    views = light_fields[0]
    t, s = np.argwhere((views.positions_mm == 0).all(axis=2))[0]
    v, u = np.mgrid[0 : views.height_px, 0 : views.width_px]
    depth_mm = (500.0 + u - v).astype(np.float32)
    sure = np.where(u > 3, np.float32(0.9), np.float32(0.1))
    return DepthMap(views=views, view=(int(t), int(s)), depth_mm=depth_mm, sigma_mm=depth_mm, confidence=sure)


@pytest.fixture(scope="module")
def shown(
    tmp_path_factory: pytest.TempPathFactory, light_fields: list[LightField], depth: DepthMap
) -> dict[str, dict[str, list[Any]]]:
    """The values of each component of each entity, one a frame or one for all."""
    path = tmp_path_factory.mktemp("rerun") / "a.rrd"
    recording = rerun.RecordingStream("mirrorcam")
    recording.save(path)
    viewer = RerunViewer(recording)
    for time_s, light_field in zip(TIMES_S, light_fields, strict=True):
        viewer.show(time_s, light_field, depth)
    recording.flush()
    recording.disconnect()
    found: dict[str, dict[str, list[Any]]] = {}
    for chunk in rerun.chunk.RrdReader(path).stream():
        batch = chunk.to_record_batch()
        for name in batch.schema.names:
            if ":" in name or name == TIME:
                values = found.setdefault(chunk.entity_path, {}).setdefault(name, [])
                values += batch.column(name).to_pylist()
    return found


def test_each_view_is_a_pinhole_at_its_place_with_its_picture(
    shown: dict[str, dict[str, list[Any]]], light_fields: list[LightField]
) -> None:
    views = light_fields[0]
    for view in np.ndindex(3, 3):
        entity = shown[f"/{SCENE}/view_{view[0]}_{view[1]}"]
        ((place,),) = entity["Transform3D:translation"]
        np.testing.assert_allclose(place, views.positions_mm[view] / 1000.0, rtol=1e-6)
        ((matrix,),) = entity["Pinhole:image_from_camera"]
        expected = views.matrices[view] + [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]]
        np.testing.assert_allclose(np.reshape(matrix, (3, 3)).T, expected, rtol=1e-6)
        ((size,),) = entity["Pinhole:resolution"]
        assert size == [views.width_px, views.height_px]
        buffers = [np.array(buffer, np.uint8) for (buffer,) in entity["Image:buffer"]]
        for buffer, light_field in zip(buffers, light_fields, strict=True):
            assert np.array_equal(buffer, light_field.samples[view].ravel())
    assert shown[f"/{SCENE}"]["ViewCoordinates:xyz"]


def test_depth_is_in_metres_and_points_are_those_of_sure_pixels(
    shown: dict[str, dict[str, list[Any]]], light_fields: list[LightField], depth: DepthMap
) -> None:
    z = depth_m(depth)
    (buffer,) = shown[f"/{DEPTH}"]["DepthImage:buffer"][0]
    assert np.array_equal(np.array(buffer, np.uint8).view(np.float32), z.ravel(), equal_nan=True)
    points = np.array(shown[f"/{SCENE}/points"]["Points3D:positions"][1])
    v, u = np.nonzero(np.isfinite(z))
    assert len(points) == len(u) < z.size
    views = light_fields[0]
    projected = views.project_in_view(points * 1000.0)[depth.view]
    np.testing.assert_allclose(projected, np.column_stack([u, v]), atol=1e-3)
    colours = np.array(shown[f"/{SCENE}/points"]["Points3D:colors"][1], np.uint32)
    assert np.array_equal(colours >> 24, light_fields[1].samples[depth.view][v, u, 0])


def test_frames_are_at_their_times(shown: dict[str, dict[str, list[Any]]]) -> None:
    times = shown[f"/{DEPTH}"][TIME]
    assert [each.total_seconds() for each in times] == pytest.approx(TIMES_S)


class Recording:
    """What a recording of rerun is to `RerunViewer.opened`."""

    def __init__(self, name: str) -> None:
        self.leads_to = ""

    def connect_grpc(self, address: str) -> None:
        self.leads_to = address

    def disconnect(self) -> None:
        self.leads_to = "nowhere"


@pytest.fixture
def port(monkeypatch: pytest.MonkeyPatch) -> int:
    """A port on which no viewer listens, instead of rerun's own; there is a display."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        free = int(taken.getsockname()[1])
    monkeypatch.setattr(rerun_viewer, "PORT", free)
    monkeypatch.setattr(rerun, "RecordingStream", Recording)
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setenv("DISPLAY", ":0")
    return free


def test_a_viewer_that_ends_at_once_is_reported(monkeypatch: pytest.MonkeyPatch, port: int) -> None:
    asked = dict[str, Any]()
    monkeypatch.setattr(rerun, "spawn", asked.update)
    with pytest.raises(InputError, match=r"^--view: rerun's viewer does not start: it ended at once$"):
        RerunViewer.opened()
    assert asked["port"] == port

    def fail(**_: Any) -> None:
        raise RuntimeError("no such\nprogram")

    monkeypatch.setattr(rerun, "spawn", fail)
    with pytest.raises(InputError, match=r"does not start: no such program$"):
        RerunViewer.opened()


def test_a_viewer_that_is_open_is_used_also_without_a_display(monkeypatch: pytest.MonkeyPatch, port: int) -> None:
    monkeypatch.delenv("DISPLAY")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(InputError, match=f"no display: expected one, or a rerun viewer that listens on port {port}"):
        RerunViewer.opened()
    with socket.create_server(("127.0.0.1", port)):
        recording: Any = RerunViewer.opened()._recording
    assert recording.leads_to == f"rerun+http://127.0.0.1:{port}/proxy"


def test_without_rerun_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mirrorcam.core.extras.find_spec", lambda module: None)
    with pytest.raises(InputError, match=r'rerun not installed.*pip install "mirrorcam\[view\]"'):
        RerunViewer.opened()
