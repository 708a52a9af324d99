"""`mirrorcam calibrate --labels`: from tables to files, and back."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from mirrorcam.cli import main
from mirrorcam.core.images.pictures import write_image
from mirrorcam.optics.calibration.labels.label_files import read_labels
from mirrorcam.optics.calibration.solver.observations import DIRECT
from mirrorcam.optics.camera_files.read.anipose import read_anipose
from mirrorcam.optics.geometry.layout import Layout
from tests.optics.calibration.labels.simulated_labels import CAMERA, Simulated, simulated

CAMERA_YAML = """image_width: 1280
image_height: 1024
camera_matrix: {rows: 3, cols: 3, data: [1400.0, 0, 650.0, 0, 1402.0, 500.0, 0, 0, 1]}
distortion_coefficients: {rows: 1, cols: 5, data: [-0.12, 0.08, 0.0005, -0.0006, 0]}
"""


@pytest.fixture
def labels(tmp_path: Path) -> Simulated:
    labels = simulated(0, mirrors=2, frames=40)
    table = labels.table
    with (tmp_path / "labels.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(("frame", "view", "label", "x_px", "y_px"))
        for frame, view, label, (x, y) in zip(table.frame, table.view, table.label, table.pixels, strict=True):
            writer.writerow((table.frames[frame], table.views[view - DIRECT], table.labels[label], x, y))
    (tmp_path / "camera.yaml").write_text(CAMERA_YAML)
    return labels


def test_from_labels_to_cameras_of_other_tools(labels: Simulated, tmp_path: Path) -> None:
    known = ("--known-length", "camera", "mirror 0", f"{np.linalg.norm(labels.centres[0]) / 2.0}")
    given = ("--labels", str(tmp_path / "labels.csv"), "--camera", str(tmp_path / "camera.yaml"))
    out = tmp_path / "out"
    assert main(["calibrate", *given, *known, "--out", str(out)]) == 0
    layout = Layout.load(out / "layout.json")
    for mirror, centre in zip(layout.mirrors, labels.centres, strict=True):
        np.testing.assert_allclose(mirror.virtual_centre_in_rig_mm, centre, atol=8.0)
    assert json.loads((out / "metrics.json").read_text())["rejected_labels"]["value"] > 50
    report = (out / "report.html").read_text()
    assert "Good to use" in report
    assert "paw_fl" in report
    points = list(csv.DictReader((out / "points.csv").open()))
    first = points[0]
    true = labels.points[int(first["frame"]), labels.table.labels.index(first["label"])]
    np.testing.assert_allclose([float(first[f"{axis}_mm"]) for axis in "xyz"], true, atol=8.0)
    again = read_labels([out / "labels.csv"])
    assert again.views == labels.table.views
    assert main(["camera", "export", str(out / "layout.json"), "--out", str(tmp_path / "cameras")]) == 0
    rig = read_anipose(tmp_path / "cameras" / "anipose" / "calibration.toml")
    assert [camera.name for camera in rig.cameras] == ["view_0_0", "view_0_1"]


def test_a_data_sheet_and_a_picture(labels: Simulated, tmp_path: Path) -> None:
    write_image(tmp_path / "picture.png", np.zeros((1024, 1280, 3), dtype=np.uint8))
    given = ("--labels", str(tmp_path / "labels.csv"), "--field-of-view", "49", "1")
    assert main(["calibrate", str(tmp_path / "picture.png"), *given, "--out", str(tmp_path / "out")]) == 0
    layout = Layout.load(tmp_path / "out" / "layout.json")
    assert layout.camera.fx_px == pytest.approx(CAMERA.fx_px, rel=0.06)
    assert layout.uncertainty is not None
    assert layout.uncertainty.parameters[:4] == ("fx_px", "fy_px", "cx_px", "cy_px")
    # The calibrated camera, with its covariance, serves for other labels.
    again = ("--labels", str(tmp_path / "labels.csv"), "--camera", str(tmp_path / "out" / "layout.json"))
    assert main(["calibrate", *again, "--out", str(tmp_path / "again")]) == 0
    second = Layout.load(tmp_path / "again" / "layout.json")
    assert second.uncertainty is not None
    assert second.uncertainty.covariance[0, 0] < layout.uncertainty.covariance[0, 0]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (("--labels", "labels.csv"), "expected --camera FILE, or a picture"),
        (("--labels", "labels.csv", "--board", "board.toml"), "--labels goes without --board"),
        (("--labels", "labels.csv", "--camera", "camera.yaml", "--field-of-view", "49", "1"), "and no --camera"),
        (("--labels", "labels.csv", "--camera", "camera.yaml", "--known-length", "camera", "top", "9"), "'top'"),
        (("--board", "board.toml", "--direct-view", "2", "--views", "direct"), "go with --labels only"),
        (("--direct-view", "2"), "expected --board FILE, or --labels"),
        ((), "expected --board FILE, or --labels"),
    ],
)
def test_what_does_not_go_together_is_refused(
    labels: Simulated,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    given: tuple[str, ...],
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["calibrate", *given, "--out", "out"]) == 2
    assert message in capsys.readouterr().err


def test_a_published_camera_is_a_data_sheet(labels: Simulated, tmp_path: Path) -> None:
    camera = 'name = "mine"\nwidth_px = 1280\nheight_px = 1024\nfx_px = 1410.0\nfy_px = 1410.0\n'
    (tmp_path / "mine.toml").write_text(camera + "cx_px = 639.5\ncy_px = 511.5\n")
    given = ("--labels", str(tmp_path / "labels.csv"), "--camera", str(tmp_path / "mine.toml"))
    assert main(["calibrate", *given, "--out", str(tmp_path / "out")]) == 0
    uncertainty = Layout.load(tmp_path / "out" / "layout.json").uncertainty
    assert uncertainty is not None
    assert 10.0 < np.sqrt(uncertainty.covariance[0, 0]) < 42.5
