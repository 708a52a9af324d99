"""docs/library.md: what it names exists, and its code runs."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import mirrorcam
from docs.page_code import blocks
from mirrorcam.calibration.validation import mirror_errors
from mirrorcam.render_scenes.truth.corners import VISIBLE_MARGIN_PX

CAMERA = mirrorcam.Camera(width_px=960, height_px=540, fx_px=680.0, fy_px=680.0, cx_px=479.5, cy_px=269.5)
LONGEST_TASK = 10
"""Lines of a task, without imports, comments and empty lines."""
WIDEST = 88
"""Characters of a line that the page shows without scrolling."""
ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "library.md").read_text(encoding="utf-8")


SECTIONS = PAGE.partition("## Eight tasks")[2].partition("\n## ")[0].split("\n### ")[1:]
TASKS = {section.partition("\n")[0]: blocks(section, "python")[0].text for section in SECTIONS}


def run(program: str, folder: Path) -> str:
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=folder, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stdout


def test_the_tables_name_the_public_names() -> None:
    section = PAGE[PAGE.index("## Public names") : PAGE.index("## Everything else")]
    cells = [line.split("|")[1] for line in section.splitlines() if line.startswith("| `")]
    named = {name for cell in cells for name in re.findall(r"`([A-Za-z_]+)", cell)}
    assert sorted(named) == mirrorcam.__all__


def test_the_examples_are_listed() -> None:
    listed = set(re.findall(r"\(\.\./examples/(\w+\.py)\)", PAGE))
    assert listed == {path.name for path in (ROOT / "examples").glob("*.py")}


@pytest.mark.slow
@pytest.mark.skipif(find_spec("mitsuba") is None, reason="rendering needs the extra render")
def test_the_programs_of_the_page_run(tmp_path: Path) -> None:
    sure = run("".join(block.text for block in blocks(PAGE, "python")[:2]), tmp_path)
    assert float(sure.partition("%")[0]) > 30.0
    out = tmp_path / "output" / "library"
    assert (out / "points.ply").stat().st_size > 100_000


def test_each_task_takes_ten_lines() -> None:
    assert len(TASKS) == 8
    for title, program in TASKS.items():
        lines = [line for line in program.splitlines() if line and not line.lstrip().startswith(("import ", "#"))]
        assert len(lines) <= LONGEST_TASK, title
        assert max(map(len, lines)) <= WIDEST, title


@pytest.mark.slow
@pytest.mark.parametrize("page", ["library.md", "calibration.md"])
def test_programs_pass_a_type_checker_without_plugins(page: str, tmp_path: Path) -> None:
    programs = blocks((ROOT / "docs" / page).read_text(encoding="utf-8"), "python")
    for number, program in enumerate(programs):
        (tmp_path / f"program_{number}.py").write_text(program.text, encoding="utf-8")
    checked = subprocess.run(
        [sys.executable, "-m", "mypy", "--config-file=", "--follow-imports=silent", *sorted(tmp_path.glob("*.py"))],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env={**os.environ, "MYPYPATH": str(ROOT / "src")},
        check=False,
    )
    assert checked.returncode == 0, checked.stdout


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the files that the tasks read, of a rendered device: its board moves in a video."""
    if find_spec("mitsuba") is None:  # not by importing it: that would choose an LLVM
        pytest.skip("rendering needs the extra render")
    folder = tmp_path_factory.mktemp("recorded")
    request = mirrorcam.SetRequest(
        layout=mirrorcam.design(mirrorcam.DesignSpec(camera=CAMERA, rows=1, cols=3)),
        board=BOARD,
        frames=6,
        base_frames=5,
        rate_hz=2.0,
        # A frame of a global shutter shows one pose of the board.
        settings=mirrorcam.RenderSettings(
            renderer="fast", maps=False, video="mp4", sensor=mirrorcam.SensorModel(readout_ms=0.0)
        ),
    )
    dataset = mirrorcam.render_set(request, folder / "set")
    names = {"layout.json": "truth/layout.json", "nominal.json": "layout.json", "poses.json": "truth/poses.json"}
    for name, source in {**names, "video.mp4": "video.mp4", "frame.png": dataset.frame_names[0]}.items():
        shutil.copy(folder / "set" / source, folder / name)
    frames, base_frames = (
        np.stack([mirrorcam.read_image(folder / "set" / name, grey=True) for name in names])
        for names in (dataset.frame_names, dataset.base_names)
    )
    np.savez(folder / "pictures.npz", frames=frames, base_frames=base_frames)
    return folder


BOARD = mirrorcam.Charuco(cols=12, rows=8, square_mm=24.0, marker_mm=18.0)
OFF_BOARD = f"""
import json
import numpy as np
def off_board_mm(points_mm, frame):
    board_from_rig = np.linalg.inv(json.load(open("poses.json"))["frames"][frame])
    x, y, z = (points_mm.reshape(-1, 3) @ board_from_rig[:3, :3].T + board_from_rig[:3, 3]).T
    width, height = {BOARD.size_mm}
    return np.abs(z[(x > 0) & (x < width) & (y > 0) & (y < height)])
"""
"""Distances of points from the plane of the board in a frame, where they are within its print."""


def printed_by(title: str, folder: Path, check: str = "", **changed: str) -> list[str]:
    """The lines that a task prints, and those of a check that uses its variables."""
    program = TASKS[title]
    for old, new in changed.items():
        assert old in program
        program = program.replace(old, new)
    return run(f"{program}\n{check}", folder).splitlines()


@pytest.mark.slow
def test_a_video_becomes_metric_points(recorded: Path) -> None:
    *lines, off_mm = printed_by(
        "A video to metric points", recorded, OFF_BOARD + "print(np.median(off_board_mm(points_mm, 5)))"
    )
    assert len(lines) == 6
    assert "frame 5, 2.50 s" in lines[5]
    assert float(off_mm) < 1.0


@pytest.mark.slow
def test_the_points_of_one_frame_are_on_the_board(recorded: Path) -> None:
    *_, off_mm = printed_by(
        "The points of one frame", recorded, OFF_BOARD + "print(np.median(off_board_mm(points_mm, 0)))"
    )
    assert float(off_mm) < 0.5


@pytest.mark.slow
def test_points_are_projected_by_name(recorded: Path) -> None:
    # The set's truth counts no corner within its margin of a sub-image's edge.
    check = f"""
angles = np.linspace(0.0, 2.0 * np.pi, 65)
margin_px = {VISIBLE_MARGIN_PX} * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
true = np.load("set/truth/corners.npz")
corners = np.append(BOARD_CORNERS, np.ones((len(BOARD_CORNERS), 1)), axis=1)
points_mm = (corners @ np.array(json.load(open("poses.json"))["frames"][0]).T)[:, :3]
for index, name in enumerate(layout.mirror_names):
    pixels, visible = layout.project(points_mm, name), true["frames_visible"][0, index]
    errors_px = np.linalg.norm(pixels - true["frames_px"][0, index], axis=1)[visible]
    inside = layout.shows(pixels[:, None] + margin_px, name).all(axis=1)
    print(len(errors_px), errors_px.max(), np.array_equal(inside, visible))
"""
    corners = f"import json\nBOARD_CORNERS = np.array({BOARD.corners_in_board_mm.tolist()})"
    lines = printed_by("Points into the views, by name", recorded, corners + check)
    assert [line.split()[0] for line in lines[:3]] == ["0-0", "0-1", "0-2"]
    assert all(line.endswith("[True, True]") for line in lines[:3])
    for line in lines[3:]:
        count, largest_px, same = line.split()
        assert int(count) > 20
        assert float(largest_px) < 1e-6
        assert same == "True"


@pytest.mark.slow
def test_arrays_are_calibrated(recorded: Path) -> None:
    lines = printed_by("Calibrate from arrays", recorded)
    reported = [tuple(map(int, re.findall(r"\d+", line))) for line in lines if line.startswith("step ")]
    assert [done for done, _ in reported] == list(range(len(reported)))
    assert len(reported) > 11  # the pictures, and the solution
    assert reported[-1][0] == reported[-1][1]
    assert reported == sorted(reported)  # the total never decreases
    calibrated, truth = (mirrorcam.Layout.load(recorded / name) for name in ("calibrated.json", "layout.json"))
    assert mirror_errors(calibrated, truth)["normal_error_max_deg"].value < 0.02


@pytest.mark.slow
def test_the_newest_frame_of_a_stream_is_measured(recorded: Path) -> None:
    *lines, off_mm = printed_by(
        "Depth of a camera's newest frame",
        recorded,
        OFF_BOARD + "print(np.nanmedian(off_board_mm(points_mm, 5)))",
        **{'"0"': '"video.mp4"'},
    )
    times, dropped = zip(*(re.findall(r"^([\d.]+) s, (\d+) frames dropped", line)[0] for line in lines), strict=True)
    assert times[-1] == "2.50"
    assert len(lines) + int(dropped[-1]) == 6
    assert float(off_mm) < 1.0


@pytest.mark.slow
def test_a_scene_of_ones_own_is_rendered_to_scale(recorded: Path) -> None:
    check = """
depth = mirrorcam.estimate_depth(mirrorcam.Decoder(layout).decode(frame))
depths_mm = depth.depth_mm[depth.confidence > 0.9]
print(np.median(depths_mm), depths_mm.min())
for name in layout.mirror_names:
    column, row = layout.project(ball[:3, 3] @ layout.view_from_rig, name).round().astype(int)
    red, green, blue = frame[row, column].tolist()
    print(red > 2 * green > 0, red > 2 * blue > 0)
print(np.array_equal(mirrorcam.render_frame(layout, objects), frame))
"""
    figures, *balls, same = printed_by("One frame of your own scene", recorded, check)
    wall_mm, nearest_mm = map(float, figures.split())
    assert abs(wall_mm - 500.0) < 1.0
    assert abs(nearest_mm - 360.0) < 10.0  # the front of the ball, 20 mm before its centre
    assert balls == ["True True"] * 3  # the middle of the ball is where each view projects it
    assert same == "True"


def test_a_layout_is_made_from_planes(tmp_path: Path) -> None:
    printed_by("A layout from planes", tmp_path)
    layout = mirrorcam.Layout.load(tmp_path / "own.json")
    for mirror, x in zip(layout.mirrors, (-16.0, 16.0), strict=True):
        np.testing.assert_allclose(mirror.outline_in_rig_mm.mean(axis=0), [x, 0.0, 90.0], atol=1e-9)
    # Both views see a plane in common, and the left mirror's virtual camera is on the left.
    assert mirrorcam.Decoder(layout).views.step_mm("s") > 20.0


def test_a_design_reports_its_searches(tmp_path: Path) -> None:
    lines = printed_by("Design with progress", tmp_path)
    reported = [tuple(map(int, re.findall(r"\d+", line))) for line in lines if line.startswith("search")]
    assert reported[0][0] == 0
    assert reported[-1][0] == reported[-1][1] > 1
    assert all(done <= total for done, total in reported)
    assert any(line.startswith("fov_x_deg: ") for line in lines)
