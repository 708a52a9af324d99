"""`mirrorcam export`, from any format to any other."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from mirrorcam.cli import main
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import write_image
from mirrorcam.core.values import FloatArray
from mirrorcam.lightfield.export_command import ExportRequest, export_light_field
from mirrorcam.optics.light_field.io.formats import registry
from mirrorcam.optics.light_field.io.formats.hci import read_hci, write_hci
from mirrorcam.optics.light_field.io.formats.npz import load_npz, save_npz
from mirrorcam.optics.light_field.light_field import LightField
from tests.command_line import assert_refused_here
from tests.optics.light_field.depth.surfaces import Surface, grid_views, photograph

SURFACE = Surface(520.0, slope=(0.25, -0.15))


@pytest.fixture(scope="module")
def scene() -> tuple[LightField, FloatArray]:
    light_field, depth, _ = photograph(grid_views(), [SURFACE])
    return light_field, depth


def point_cloud_in(path: Path) -> tuple[FloatArray, Any]:
    """Points (n, 3) and colours (n, 4) of a point cloud, as another program reads them."""
    cloud: Any = trimesh.load(path)
    return np.asarray(cloud.vertices, np.float64), cloud.colors


def off_surface_mm(points_in_rig: FloatArray, light_field: LightField) -> FloatArray:
    in_view = (points_in_rig - light_field.reference_view_in_rig_mm) @ light_field.view_from_rig.T
    return in_view[:, 2] - SURFACE.distance_mm - in_view[:, :2] @ SURFACE.slope


def test_a_light_field_goes_through_every_format_and_comes_back(
    scene: tuple[LightField, FloatArray], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "tabletop.npz"
    save_npz(path, scene[0])
    for to in registry.NAMES:
        if to != "ply":
            out = tmp_path / to
            assert main(["export", str(path), "--to", to, "--out", str(out)]) == 0
            path = out / f"tabletop{registry.formats()[to].ending}"
            assert f"{path} written ({to})" in capsys.readouterr().out
    assert main(["export", str(path), "--to", "npz", "--out", str(tmp_path / "back")]) == 0
    back = load_npz(tmp_path / "back/tabletop.npz")
    assert np.array_equal(back.samples, scene[0].samples)
    assert np.array_equal(back.weights, scene[0].weights)
    assert np.array_equal(back.positions_mm, scene[0].positions_mm)
    assert back.layout_identity == scene[0].layout_identity


@pytest.mark.slow
def test_the_depth_command_reads_other_tools_files(scene: tuple[LightField, FloatArray], tmp_path: Path) -> None:
    paths = []
    for to in ("lftoolbox", "hci", "stanford"):
        paths.append(tmp_path / f"{to}{'.mat' if to == 'lftoolbox' else ''}")
        registry.write_light_field(paths[-1], scene[0], to)
    assert main(["depth", *map(str, paths), "--out", str(tmp_path / "out")]) == 0
    for to in ("lftoolbox", "hci", "stanford"):
        with np.load(tmp_path / f"out/{to}_depth.npz") as arrays:
            assert np.nanmedian(np.abs(arrays["depth_mm"] - scene[1])) < 2.0


def test_geometry_that_a_file_lacks_is_in_its_views_toml(
    scene: tuple[LightField, FloatArray], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    registry.write_light_field(tmp_path / "views_tiles.png", scene[0], "tiles")
    (tmp_path / "views_tiles.json").unlink()
    arguments = ["refocus", str(tmp_path / "views_tiles.png"), "--out", str(tmp_path / "out")]
    sidecar = tmp_path / "views_tiles.views.toml"
    expected = f"give --layout of the camera that took the frame, or rows and cols of the views in {sidecar.name}"
    assert_refused_here(arguments, capsys, expected)
    sidecar.write_text("rows = 3\ncols = 3\n", encoding="utf-8")
    assert_refused_here(arguments, capsys, f"its step_mm, focal_px, reference_depth_mm: expected in {sidecar.name}")
    sidecar.write_text("rows = 3\ncols = 3\nstep_mm = 20\nfocal_px = 400\nreference_depth_mm = 500\n", encoding="utf-8")
    assert main(arguments) == 0
    assert (tmp_path / "out" / "views_tiles_focus_500mm.png").exists()
    assert main(["export", arguments[1], "--to", "npz", "--out", str(tmp_path / "out")]) == 0
    assert load_npz(tmp_path / "out" / "views.npz").reference_depth_mm == 500.0


def test_views_whose_disparity_is_zero_at_infinity_have_depth(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Pictures that nobody rectified, in a folder with names of rows and columns."""
    views = grid_views(uneven=False)
    positions = views.positions_mm
    unrectified = grid_views(uneven=False, reference_depth_mm=1e7, reference_view_in_rig_mm=np.zeros(3))
    light_field, distance_mm, _ = photograph(unrectified, [SURFACE])
    for t, s in np.ndindex(3, 3):
        write_image(tmp_path / "set" / f"2067_{t + 1:02d}_{s + 1:02d}.png", light_field.samples[t, s].astype(np.uint8))
    geometry = f"step_mm = {positions[1, 2, 0]:g}\nfocal_px = 400\nreference_depth_mm = inf\n"
    (tmp_path / "set" / "views.toml").write_text(geometry, encoding="utf-8")
    arguments = ["depth", str(tmp_path / "set"), "--far-mm", "900", "--out", str(tmp_path)]
    assert main(arguments) == 2
    assert "the reference plane is at infinity, expected near_mm" in capsys.readouterr().err
    assert main([*arguments, "--near-mm", "350"]) == 0
    with np.load(tmp_path / "set_depth.npz") as arrays:
        found, sure = arrays["depth_mm"], arrays["confidence"] > 0.5
    assert sure.mean() > 0.2
    middle = np.s_[35:55, 50:70]
    assert np.nanmedian(np.abs(found - distance_mm)[middle] / distance_mm[middle]) < 0.03


def test_a_point_cloud_has_the_depth_measured_here(
    scene: tuple[LightField, FloatArray], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    save_npz(tmp_path / "tabletop.npz", scene[0])
    assert main(["export", str(tmp_path / "tabletop.npz"), "--to", "ply", "--out", str(tmp_path)]) == 0
    assert "depth estimated: " in capsys.readouterr().out
    points, _ = point_cloud_in(tmp_path / "tabletop.ply")
    assert len(points) > 5000
    assert np.median(np.abs(off_surface_mm(points, scene[0]))) < 2.0


def test_a_point_cloud_has_the_depth_of_the_depth_command(
    scene: tuple[LightField, FloatArray], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    save_npz(tmp_path / "tabletop.npz", scene[0])
    assert main(["depth", str(tmp_path / "tabletop.npz"), "--out", str(tmp_path)]) == 0
    depth = ["--depth", str(tmp_path / "tabletop_depth.npz"), "--out", str(tmp_path)]
    assert main(["export", str(tmp_path / "tabletop.npz"), "--to", "ply", *depth]) == 0
    points, _ = point_cloud_in(tmp_path / "tabletop.ply")
    assert np.median(np.abs(off_surface_mm(points, scene[0]))) < 2.0
    assert main(["export", str(tmp_path / "tabletop.npz"), "--to", "hci", *depth]) == 0
    with np.load(tmp_path / "tabletop_depth.npz") as arrays:
        known = np.isfinite(arrays["depth_mm"])
        expected = scene[0].disparity_px_from_depth(arrays["depth_mm"].astype(float))
    found = read_hci(tmp_path / "tabletop_hci").disparity_px
    assert found is not None
    assert np.allclose(found[known], expected[known], atol=1e-4)
    capsys.readouterr()
    save_npz(tmp_path / "other.npz", photograph(grid_views(layout_identity="other"), [SURFACE])[0])
    assert main(["export", str(tmp_path / "other.npz"), "--to", "ply", *depth]) == 2
    assert "tabletop_depth.npz: layout '0123456789abcdef', expected 'other'" in capsys.readouterr().err
    (tmp_path / "bad.npz").write_bytes(b"bad")
    assert main(["export", str(tmp_path / "tabletop.npz"), "--to", "ply", "--depth", str(tmp_path / "bad.npz")]) == 2
    assert "not a depth map of mirrorcam depth" in capsys.readouterr().err


def test_a_scene_with_truth_brings_its_depth_along(scene: tuple[LightField, FloatArray], tmp_path: Path) -> None:
    write_hci(tmp_path / "scene", scene[0], scene[1].astype(np.float32))
    assert main(["export", str(tmp_path / "scene"), "--to", "ply", "--out", str(tmp_path)]) == 0
    points, colours = point_cloud_in(tmp_path / "scene.ply")
    assert len(points) == len(colours) == scene[1].size
    assert np.abs(off_surface_mm(points, scene[0])).max() < 0.01


def test_bad_input_ends_in_one_line(
    scene: tuple[LightField, FloatArray], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    dark = LightField.of(scene[0], np.zeros_like(scene[0].samples), scene[0].weights)
    save_npz(tmp_path / "dark.npz", dark)
    (tmp_path / "a.txt").write_text("no", encoding="utf-8")
    (tmp_path / "out" / "dark_colmap").mkdir(parents=True)
    (tmp_path / "out" / "dark_colmap" / "mine").write_text("mine", encoding="utf-8")
    for name, to, message in (
        ("dark.npz", "ply", "no depth with confidence above 0.5"),
        ("dark.npz", "colmap", "dark_colmap/mine: was not written by this command"),
        ("a.txt", "npz", "its name is not that of a light field"),
        ("missing", "npz", "its name is not that of a light field"),
        ("dark.npz", "jpeg", "Input should be 'colmap', "),
    ):
        arguments = ["export", str(tmp_path / name), "--to", to, "--out", str(tmp_path / "out")]
        assert_refused_here(arguments, capsys, message)
    assert not (tmp_path / "out" / "dark.ply").exists()


def test_what_was_written_is_named(scene: tuple[LightField, FloatArray], tmp_path: Path) -> None:
    save_npz(tmp_path / "wall.npz", scene[0])
    found = export_light_field(tmp_path / "wall.npz", tmp_path / "out", ExportRequest(to="lftoolbox"))
    assert found.path == tmp_path / "out" / "wall.mat"
    assert found.path.exists()
    assert found.measured is None


def test_depth_without_a_sure_pixel_is_no_point_cloud(scene: tuple[LightField, FloatArray], tmp_path: Path) -> None:
    blank = LightField.of(scene[0], np.full_like(scene[0].samples, 90), scene[0].weights)
    save_npz(tmp_path / "blank.npz", blank)
    with pytest.raises(InputError, match=r"no depth with confidence above 0\.5"):
        export_light_field(tmp_path / "blank.npz", tmp_path, ExportRequest(to="ply"))
    assert not (tmp_path / "blank.ply").exists()
