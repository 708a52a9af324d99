"""Point clouds: on the scene, and read by another program."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.depth import DepthMap
from mirrorcam.optics.light_field.io.formats.ply import point_cloud, write_ply
from mirrorcam.optics.light_field.io.formats.registry import write_light_field
from mirrorcam.optics.light_field.light_field import LightField


def test_point_clouds_lie_on_the_scene_and_open_elsewhere(scene: tuple[LightField, FloatArray], tmp_path: Path) -> None:
    light_field, depth = scene
    holes = depth.copy()
    holes[:20] = np.nan
    cloud, colours = point_cloud(light_field, holes)
    write_ply(tmp_path / "a.ply", cloud, colours)
    opened: Any = trimesh.load(tmp_path / "a.ply")
    assert np.allclose(opened.vertices, cloud, atol=1e-4)
    assert np.array_equal(opened.colors[:, :3], colours)
    assert len(cloud) == 160 * 240
    # In the rig, the depth from the pupil is y; pixels of the middle view show the points.
    assert np.allclose(cloud[:, 1], depth[20:].ravel())
    assert np.allclose(light_field.project(cloud)[1, 1], light_field.pixel_grid()[20:].reshape(-1, 2), atol=1e-6)


def test_open3d_opens_the_same_points_and_colours(scene: tuple[LightField, FloatArray], tmp_path: Path) -> None:
    # Its system libraries may be missing, too.
    open3d = pytest.importorskip("open3d", reason="Open3D is not installed", exc_type=ImportError)
    cloud, colours = point_cloud(*scene)
    write_ply(tmp_path / "a.ply", cloud, colours)
    opened = open3d.io.read_point_cloud(str(tmp_path / "a.ply"))
    assert np.allclose(np.asarray(opened.points), cloud, atol=1e-4)
    assert np.array_equal(np.rint(255.0 * np.asarray(opened.colors)), colours)


def test_points_of_a_depth_map_state_how_sure_they_are(scene: tuple[LightField, FloatArray], tmp_path: Path) -> None:
    """Doubtful ones are left out by default."""
    light_field, depth_mm = scene
    confidence = np.broadcast_to(np.linspace(0.0, 1.0, 240, dtype=np.float32), (180, 240)).copy()
    sigma_mm = np.broadcast_to(np.arange(180, dtype=np.float32)[:, None], (180, 240)).copy()
    depth = DepthMap(
        views=light_field,
        view=(1, 1),
        depth_mm=depth_mm.astype(np.float32),
        sigma_mm=sigma_mm,
        confidence=confidence,
    )
    for name, kept in (("default", confidence > 0.5), ("sure", confidence > 0.9), ("all", confidence >= 0)):
        limits: dict[str, float] = {"sure": {"min_confidence": 0.9}, "all": {"min_confidence": -1.0}}.get(name, {})
        write_light_field(tmp_path / f"{name}.ply", light_field, "ply", depth, **limits)
        vertex = trimesh.load(tmp_path / f"{name}.ply").metadata["_ply_raw"]["vertex"]["data"]
        assert np.array_equal(np.ravel(vertex["confidence"]), confidence[kept])
        assert np.array_equal(np.ravel(vertex["sigma_mm"]), sigma_mm[kept])
    write_light_field(tmp_path / "true.ply", light_field, "ply", depth.depth_mm)
    assert b"confidence" not in (tmp_path / "true.ply").read_bytes()[:400]


def test_depths_of_other_sizes_are_refused(scene: tuple[LightField, FloatArray]) -> None:
    with pytest.raises(InputError, match="expected 240x180"):
        point_cloud(scene[0], scene[1][1:])
