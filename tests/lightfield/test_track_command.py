"""`mirrorcam track`: it writes what the tracker finds, says where it is lost, and bad input is one line."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirrorcam import cli
from mirrorcam.core.progress import Progress, no_progress
from mirrorcam.lightfield.light_field_inputs import LightFieldInputs, NamedLightField
from mirrorcam.lightfield.requests import TrackRequest
from mirrorcam.lightfield.track_command import draw_trajectory, write_trajectory
from mirrorcam.optics.geometry.transforms import rigid
from mirrorcam.optics.light_field.io.formats.npz import load_npz, save_npz
from mirrorcam.optics.light_field.motion import LightFieldTracker, TrackedPose
from tests.command_line import assert_refused_here, results
from tests.drawn import drawn
from tests.optics.light_field.relief_scene import Relief, even_views, light_field_of

SIZE: dict[str, Any] = {"width_px": 160, "height_px": 120, "focal_px": 280.0, "centre_px": np.array([79.5, 59.5])}


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Light fields a, b and c of a camera that moves, and one of another scene."""
    folder, views = tmp_path_factory.mktemp("track"), even_views(3, 10.0, **SIZE)
    for number, name in enumerate("abc"):
        pose = rigid(np.eye(3), [8.0 * number, 3.0 * number, 0.0])
        save_npz(folder / f"{name}.npz", light_field_of(Relief(), views, world_from_view=pose, subsamples=1)[0])
    save_npz(folder / "other.npz", light_field_of(Relief(seed=4), views, subsamples=1)[0])
    return folder


@pytest.mark.slow
def test_files_hold_the_poses_of_the_tracker(stored: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = [str(stored / f"{name}.npz") for name in "abc"]
    assert cli.main(["track", *files, "--rate-hz", "10", "--out", str(tmp_path)]) == 0
    assert results(tmp_path) == ["trajectory.json", "trajectory.png", "trajectory.tum"]
    tracker = LightFieldTracker(load_npz(stored / "a.npz"))
    expected = [tracker.track(load_npz(stored / f"{name}.npz")) for name in "abc"]
    rows = np.loadtxt(tmp_path / "trajectory.tum")
    assert np.allclose(rows[:, 0], [0.0, 0.1, 0.2])
    assert np.allclose(rows[:, 1:4] * 1000.0, [pose.world_from_view[:3, 3] for pose in expected], atol=1e-5)
    assert np.linalg.norm(rows[2, 1:4] * 1000.0 - [16.0, 6.0, 0.0]) < 0.3
    frames = json.loads((tmp_path / "trajectory.json").read_text(encoding="utf-8"))["frames"]
    assert [frame["name"] for frame in frames] == ["a", "b", "c"]
    assert np.allclose(frames[2]["covariance"], expected[2].covariance)
    said = capsys.readouterr().out
    assert "3 of 3 poses, 1 key frame, path 17." in said


@pytest.mark.slow
def test_lost_light_fields_are_named_and_left_out(
    stored: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = [str(stored / f"{name}.npz") for name in ("a", "other", "c")]
    assert cli.main(["track", *files, "--out", str(tmp_path / "one")]) == 0
    assert "other: lost, because too little of the last key frame is visible" in capsys.readouterr().out
    assert len(np.loadtxt(tmp_path / "one" / "trajectory.tum")) == 2
    assert cli.main(["track", *files[:2], "--out", str(tmp_path / "two")]) == 1


@pytest.mark.slow
def test_bad_input_is_refused_in_one_line(stored: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first, out = str(stored / "a.npz"), ["--out", str(tmp_path / "out")]
    assert_refused_here(["track", first, *out], capsys, "1 light field, expected at least two")
    save_npz(tmp_path / "wide.npz", light_field_of(Relief(), even_views(3, 12.0, **SIZE), subsamples=1)[0])
    both = ["track", first, str(tmp_path / "wide.npz"), *out]
    assert_refused_here(both, capsys, "differs in its views from layout")
    assert_refused_here(
        ["track", first, "--near-mm", "500", "--far-mm", "400", *out], capsys, "the nearest depth must be less"
    )
    assert_refused_here(["track", str(tmp_path / "no.npz"), first, *out], capsys, "no.npz")
    assert not (tmp_path / "out" / "trajectory.tum").exists()


@pytest.mark.slow
@pytest.mark.parametrize(("times_s", "expected"), [((5.0, 5.2), [5.0, 5.2]), ((None, None), [0.0, 0.5])])
def test_times_are_those_of_the_file_or_of_the_rate(
    times_s: tuple[float | None, ...], expected: list[float], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    light_field = light_field_of(Relief(), even_views(3, 10.0, **SIZE), subsamples=1)[0]

    def open_all(self: LightFieldInputs, progress: Progress = no_progress) -> Iterator[NamedLightField]:
        for number, time_s in enumerate(times_s):
            yield NamedLightField(f"clip_{number}", light_field, None, time_s)

    monkeypatch.setattr(LightFieldInputs, "open_all", open_all)
    found = write_trajectory(LightFieldInputs((Path("clip.zarr"),)), tmp_path, TrackRequest(rate_hz=2.0))
    assert found.times_s == expected
    assert found.path_mm < 0.05
    assert np.allclose(np.loadtxt(tmp_path / "trajectory.tum")[:, 0], expected)


LOST = TrackedPose(np.full((4, 4), np.nan), np.full((6, 6), np.nan), 0, False)


def pose(number: int) -> TrackedPose:
    place = [10.0 * number, -4.0 * number, 2.0 * number]
    covariance = np.diag([0.01, 0.02, 0.06, 1e-6, 1e-6, 1e-6]) * number**2
    return TrackedPose(rigid(np.eye(3), place), covariance, 100, number == 0)


def test_paths_and_sigmas_are_drawn(tmp_path: Path) -> None:
    poses = [pose(0), pose(1), LOST, pose(3)]
    times = [0.0, 0.1, 0.2, 0.3]
    figure = drawn(lambda: draw_trajectory(tmp_path / "path.png", times, poses), tmp_path / "path.png")
    above, front, sigma = figure.axes
    np.testing.assert_allclose(
        np.asarray(above.lines[0].get_xydata(), dtype=float), [[0.0, 0.0], [10.0, 2.0], [np.nan, np.nan], [30.0, 6.0]]
    )
    np.testing.assert_allclose(
        np.asarray(front.lines[0].get_xydata(), dtype=float),
        [[0.0, 0.0], [10.0, -4.0], [np.nan, np.nan], [30.0, -12.0]],
    )
    assert front.yaxis_inverted()
    # A line along the view of each pose that is known.
    assert len(above.lines) == 1 + 3
    np.testing.assert_allclose(np.asarray(sigma.lines[0].get_ydata(), dtype=float), [0.0, 0.3, np.nan, 0.9])
    np.testing.assert_allclose(np.asarray(above.collections[1].get_offsets(), dtype=float), [[0.0, 0.0]])


def test_a_camera_that_stands_still_is_drawn(tmp_path: Path) -> None:
    draw_trajectory(tmp_path / "still.png", [0.0, 1.0], [pose(0), pose(0)])
    assert (tmp_path / "still.png").exists()
