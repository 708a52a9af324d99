"""Point clouds: on the scene, and read by another program."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.io.formats.ply import point_cloud, write_ply
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


def test_depths_of_other_sizes_are_refused(scene: tuple[LightField, FloatArray]) -> None:
    with pytest.raises(InputError, match="expected 240x180"):
        point_cloud(scene[0], scene[1][1:])
