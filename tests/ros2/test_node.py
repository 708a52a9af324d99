"""The node, with a stand-in of rclpy: topics, quality of service, parameters, and one line for what is of no use."""

from __future__ import annotations

import shutil
import subprocess
import sys
import time
import xml.etree.ElementTree as ElementTree
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirrorcam.core.video.camera_addresses import open_camera
from mirrorcam.core.video.frames import Frame
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.decoder import Decoder
from tests.core.video.videos import RATE, pictures, write_mjpeg
from tests.optics.layouts import faceted_parabola
from tests.ros2.stand_in import Ros, installed

COUNT = 5
DEPTH_TOPICS = {"depth/image_rect", "depth/camera_info", "points"}


@pytest.fixture
def ros(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Ros:
    """ROS with the parameters of a small video."""
    webcam = Camera(width_px=320, height_px=192, fx_px=230.0, fy_px=230.0, cx_px=159.5, cy_px=95.5)
    layout = faceted_parabola(webcam, DesignSpec(camera=webcam), fill=0.9)
    layout.save(tmp_path / "layout.json")
    write_mjpeg(tmp_path / "a.avi", pictures(COUNT, 320, 192))
    found = installed(monkeypatch)
    found.parameters = {"layout": str(tmp_path / "layout.json"), "device": f"file://{tmp_path / 'a.avi'}"}
    return found


def stamps_ns(messages: list[Any]) -> list[int]:
    return [each.header.stamp.sec * 10**9 + each.header.stamp.nanosec for each in messages]


def test_views_are_published_in_time_and_depth_where_somebody_listens(ros: Ros, tmp_path: Path) -> None:
    from mirrorcam_ros.node import main

    ros.listened = ("points",)
    before = time.time_ns()
    assert main() == 0
    assert time.time_ns() - before >= (COUNT - 1) / RATE * 1e9
    assert ros.logged == [("info", "the recording has ended")]
    assert len(ros.publishers) == 3 + 18 + 3
    for topic, publisher in ros.publishers.items():
        latched = topic in ("/tf_static", "views", "weights")
        assert len(publisher.sent) == (1 if latched else COUNT)
        assert (publisher.quality.durability == "latched") == latched
        assert publisher.quality.reliability == "reliable"
    images = ros.publishers["view_2_1/image_rect"].sent
    stamps = stamps_ns(images)
    assert before <= stamps[0] < before + 60 * 10**9
    assert np.array_equal(np.diff(stamps), [10**9 // RATE] * (COUNT - 1))
    assert stamps_ns(ros.publishers["points"].sent) == stamps
    assert stamps_ns(ros.publishers["view_0_0/camera_info"].sent) == stamps
    decoder = Decoder(Layout.load(tmp_path / "layout.json"))
    for message, frame in zip(images, open_camera(ros.parameters["device"], 320, 192).frames(), strict=True):
        assert isinstance(frame, Frame)
        assert np.array_equal(message.data, decoder.decode(frame.pixels).samples[2, 1].ravel())


def test_depth_is_not_measured_while_nobody_listens_or_where_it_is_off(ros: Ros) -> None:
    from mirrorcam_ros.node import main

    assert main() == 0
    assert {topic for topic, publisher in ros.publishers.items() if not publisher.sent} == DEPTH_TOPICS
    ros.publishers.clear()
    ros.over.clear()
    ros.parameters["depth"] = False
    assert main() == 0
    assert not DEPTH_TOPICS & set(ros.publishers)


def test_invalid_settings_are_reported_in_one_line(ros: Ros, capfd: pytest.CaptureFixture[str]) -> None:
    from mirrorcam_ros.node import main

    for changes, message in (
        ({"layout": "nowhere.json"}, "mirrorcam_ros: nowhere.json: no such file\n"),
        ({"device": 99}, "mirrorcam_ros: camera 99 cannot be opened, expected one on this machine (/dev/video99)\n"),
        ({"near_mm": 500.0, "far_mm": 400.0}, "mirrorcam_ros: near_mm 500, far_mm 400: expected near_mm below far_mm"),
    ):
        given = ros.parameters
        ros.parameters = given | changes
        assert main() == 2
        said = capfd.readouterr().err
        assert said.startswith(message)
        assert said.count("\n") == 1
        ros.parameters = given


def test_pictures_of_another_size_end_the_node(ros: Ros, tmp_path: Path) -> None:
    from mirrorcam_ros.node import main

    write_mjpeg(tmp_path / "small.avi", pictures(2))
    ros.parameters["device"] = f"file://{tmp_path / 'small.avi'}"
    assert main() == 0
    ((level, text),) = ros.logged
    assert level == "fatal"
    assert "small.avi gives 160x96 px, expected 320x192 of the layout's camera" in text


@pytest.mark.skipif(find_spec("setuptools") is None, reason="needs setuptools, of the extra dev")
def test_the_package_installs_its_node_launch_file_and_description(workspace: Path, tmp_path: Path) -> None:
    """With setuptools alone, as colcon does it for packages of this kind."""
    copy = tmp_path / "mirrorcam_ros"
    shutil.copytree(workspace, copy, ignore=shutil.ignore_patterns("__pycache__"))
    prefix = tmp_path / "install"
    command = [
        sys.executable,
        "setup.py",
        "-q",
        "install",
        "--prefix",
        str(prefix),
        "--single-version-externally-managed",
    ]
    subprocess.run([*command, "--record", str(tmp_path / "record")], cwd=copy, check=True, capture_output=True)
    share = prefix / "share"
    assert (share / "ament_index" / "resource_index" / "packages" / "mirrorcam_ros").is_file()
    assert (share / "mirrorcam_ros" / "launch" / "mirrorcam.launch.py").is_file()
    assert (prefix / "lib" / "mirrorcam_ros" / "light_field").is_file()
    described = ElementTree.parse(share / "mirrorcam_ros" / "package.xml").getroot()
    assert described.findtext("name") == "mirrorcam_ros"
    assert described.findtext("export/build_type") == "ament_python"
