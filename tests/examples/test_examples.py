"""The examples run as they stand, and what they write is right."""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import mirrorcam
from mirrorcam.calibration.validation import mirror_errors
from mirrorcam.optics.calibration.labels.known_scale import KnownLength
from mirrorcam.optics.calibration.labels.label_calibration import data_sheet_prior
from mirrorcam.optics.calibration.labels.label_files import read_labels
from mirrorcam.optics.calibration.labels.label_result import calibrate_labels
from tests.shared import path_without_slicer

EXAMPLES = Path(__file__).parents[2] / "examples"
# Not by importing it: that would choose an LLVM.
rendering = pytest.mark.skipif(find_spec("mitsuba") is None, reason="rendering needs the extra render")
LONGEST = 60
"""Lines that a newcomer reads at one sitting."""


def run(name: str, out: Path, *given: Path) -> str:
    """Return what an example prints; it is run from another folder, as by someone who copied it.

    Parts are not sliced: tests of `cad` do that, and it takes most of the time.
    """
    done = subprocess.run(
        [sys.executable, str(EXAMPLES / f"{name}.py"), *map(str, (out, *given))],
        capture_output=True,
        text=True,
        cwd=out.parent,
        env=os.environ | {"OMP_NUM_THREADS": "1", "PATH": path_without_slicer()},
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    assert [path.name for path in out.parent.iterdir()] == [out.name]
    return done.stdout


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.stem)
def test_examples_are_short_and_tested(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= LONGEST
    assert f"python examples/{path.name} [OUT" in text
    assert f"test_{path.stem}" in globals()


@pytest.mark.slow
def test_design_and_export_parts(tmp_path: Path) -> None:
    pytest.importorskip("build123d")
    trimesh = pytest.importorskip("trimesh")
    assert "failed: none" in run("design_and_export_parts", tmp_path / "out")
    layout = mirrorcam.Layout.load(tmp_path / "out" / "layout.json")
    assert (layout.kind, len(layout.mirrors)) == ("nominal", 2)
    device = tmp_path / "out" / "device"
    parts = sorted((device / "parts").glob("*.stl"))
    assert parts
    assert all(trimesh.load(part).is_watertight for part in parts)
    assert {"index.html", "checks.json", "assembly.step", "assembly.glb"} <= {path.name for path in device.iterdir()}


def test_animal_labels(tmp_path: Path) -> None:
    out = tmp_path / "out"
    run("animal_labels", out)
    assert sorted(path.name for path in out.glob("*.png")) == ["img000.png", "img001.png", "img002.png"]
    labels = read_labels([out / "labels.csv"], ("direct", "left", "right"))
    known = KnownLength("camera", "left", 463.1)
    result = calibrate_labels(labels, data_sheet_prior(640, 480, 702.0, 24.0), known)
    truth = {
        (line["frame"], line["label"]): [float(line[f"{axis}_mm"]) for axis in "xyz"]
        for line in csv.DictReader((out / "truth.csv").open())
    }
    points = result.points
    true = np.array(
        [truth[labels.frames[f], labels.labels[k]] for f, k in zip(points.frame, points.label, strict=True)]
    )
    assert np.median(np.linalg.norm(points.positions - true, axis=1)) < 15.0


@pytest.mark.slow
@rendering
def test_render_and_calibrate(tmp_path: Path) -> None:
    run("render_and_calibrate", tmp_path / "out")
    calibrated = mirrorcam.Layout.load(tmp_path / "out" / "calibrated.json")
    truth = mirrorcam.Layout.load(tmp_path / "out" / "set" / "truth" / "layout.json")
    assert calibrated.kind == "calibrated"
    errors = mirror_errors(calibrated, truth)
    assert errors["normal_error_max_deg"].value < 0.01
    assert errors["distance_error_max_mm"].value < 0.05


@pytest.mark.slow
@rendering
def test_decode_video(tmp_path: Path) -> None:
    assert "frame 3" in run("decode_video", tmp_path / "out")
    synthetic = tmp_path / "out" / "set"
    decoder = mirrorcam.Decoder(mirrorcam.Layout.load(synthetic / "layout.json"))
    (picture,) = (synthetic / "frames").glob("0002.*")
    wanted = decoder.decode(mirrorcam.read_image(picture))
    others = [mirrorcam.open_light_field(tmp_path / "out" / "video.zarr", frame=number) for number in range(4)]
    # The video is compressed, so that its frames are nearly the pictures that it was made of; the board moves.
    apart = [np.abs(np.asarray(each, np.float64) - np.asarray(wanted, np.float64)).mean() for each in others]
    assert np.argmin(apart) == 2
    assert apart[2] < 3.0
    np.testing.assert_array_equal(others[2].positions_mm, wanted.positions_mm)
    # The same video by the layout of the camera as it is.
    truth = synthetic / "truth" / "layout.json"
    (tmp_path / "own").mkdir()
    run("decode_video", tmp_path / "own" / "out", synthetic / "video.mp4", truth)
    own = mirrorcam.open_light_field(tmp_path / "own" / "out" / "video.zarr", frame=2)
    assert own.layout_identity == mirrorcam.Layout.load(truth).identity


@pytest.mark.slow
@rendering
def test_depth_to_ply(tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    run("depth_to_ply", tmp_path / "out")
    cloud = trimesh.load(tmp_path / "out" / "points.ply")
    assert len(cloud.vertices) > 10_000
    assert len(cloud.colors) == len(cloud.vertices)
    truth = json.loads((tmp_path / "out" / "set" / "truth" / "poses.json").read_text())
    rig_from_board = np.array(truth["frames"][0])
    # The printed side is the plane z = 0 of the board.
    off_mm = (np.asarray(cloud.vertices) - rig_from_board[:3, 3]) @ rig_from_board[:3, 2]
    assert abs(np.median(off_mm)) < 0.3
    assert np.percentile(np.abs(off_mm), 80) < 2.0


@pytest.mark.slow
def test_sweep_two_workers(tmp_path: Path) -> None:
    assert run("sweep_two_workers", tmp_path / "out").count("solved") == 6
    with (tmp_path / "out" / "sweep.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 6
    assert (tmp_path / "out" / "pareto.png").is_file()
    assert {row["status"] for row in rows} == {"solved"}
    for row in rows:
        layout = mirrorcam.Layout.load(tmp_path / "out" / row["layout"])
        assert (layout.rows, layout.cols) == (int(row["rows"]), int(row["cols"]))
        assert layout.spec is not None
        assert layout.spec.tradeoff == float(row["tradeoff"])


@pytest.mark.slow
def test_visual_servoing(tmp_path: Path) -> None:
    said = run("visual_servoing/servo", tmp_path / "out")
    with (tmp_path / "out" / "convergence.csv").open() as file:
        rows = list(csv.DictReader(file))
    light_field = [row for row in rows if row["controller"].startswith("light field")]
    distances = [float(row["distance_mm"]) for row in light_field]
    assert distances[0] > 20.0
    assert all(later < earlier for earlier, later in pairwise(distances[:8]))
    assert distances[-1] < 0.4
    assert float(light_field[-1]["turn_deg"]) < 0.05
    assert "given their median: lost" in said
    assert (tmp_path / "out" / "convergence.png").stat().st_size > 10_000
