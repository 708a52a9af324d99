"""`mirrorcam drift`: a row for each mirror, what moved, what bending allows, and the re-solved layout."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirrorcam.cli import main
from mirrorcam.core.images.pictures import write_image
from mirrorcam.optics.geometry.layout import Layout
from tests.command_line import assert_refused_here, results
from tests.optics.drift.calibrated_device import device, turned
from tests.optics.drift.textured_scenes import Shot, fractal, photograph, scene


@pytest.mark.slow
def test_a_moved_mirror_is_printed_and_solved(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    random, truth = np.random.default_rng(1), device().truth
    sheets = scene(random, (250.0, 600.0), [fractal(random, slope=0.8)], truth.camera.fx_px)
    write_image(tmp_path / "frame.png", photograph(truth, sheets, Shot(), random))
    turned(device().calibrated, 4, np.array([0.04, 0.0, 0.03])).save(tmp_path / "layout.json")
    arguments = ["drift", str(tmp_path / "frame.png"), "--layout", str(tmp_path / "layout.json")]
    assert main([*arguments, "--out", str(tmp_path / "out")]) == 1
    said = capfd.readouterr().out
    assert "a mirror has moved since the calibration: 1-1 by 0.0" in said
    assert "gravity bends the mount by 0.05° at most" in said
    assert results(tmp_path / "out") == ["drift.json", "layout.json"]
    again = ["drift", str(tmp_path / "frame.png"), "--layout", str(tmp_path / "out" / "layout.json")]
    main([*again, "--out", str(tmp_path / "again")])
    said = capfd.readouterr().out
    assert "moved since" not in said
    assert "of threshold: over 1, the mirror has moved" in said


def test_figures_that_pictures_do_not_tell_are_left_out(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    layout = device().calibrated
    layout.save(tmp_path / "layout.json")
    write_image(tmp_path / "grey.png", np.full((layout.camera.height_px, layout.camera.width_px, 3), 120, np.uint8))
    arguments = ["drift", str(tmp_path / "grey.png"), "--layout", str(tmp_path / "layout.json")]
    assert main([*arguments, "--out", str(tmp_path / "out")]) == 1
    said = capfd.readouterr().out
    assert "90.000" not in said
    assert "not enough texture to determine" in said
    row = next(line for line in said.splitlines() if "mirror 0-0" in line and "points" not in line)
    assert row.count(" -") == 5


def test_a_layout_that_is_not_calibrated_is_refused(
    tmp_path: Path, default_layout: Layout, capfd: pytest.CaptureFixture[str]
) -> None:
    default_layout.replaced(kind="nominal").save(tmp_path / "layout.json")
    write_image(tmp_path / "frame.png", np.zeros((8, 8, 3), np.uint8))
    arguments = ["drift", str(tmp_path / "frame.png"), "--layout", str(tmp_path / "layout.json")]
    assert_refused_here([*arguments, "--out", str(tmp_path / "out")], capfd, "is a nominal layout")
    assert not (tmp_path / "out").exists()
