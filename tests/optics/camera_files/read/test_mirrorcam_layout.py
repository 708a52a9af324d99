"""A layout as cameras: each projects as its mirror does, and its pose is the reflection."""

from __future__ import annotations

import numpy as np

from mirrorcam.optics.camera_files.read.mirrorcam_layout import is_layout, rig_of
from mirrorcam.optics.geometry.transforms import transform
from tests.optics.camera_files.rigs import device, pose_of


def test_cameras_project_as_the_mirrors_do() -> None:
    layout = device().truth.with_surface("second", 2.0)
    rig = rig_of(layout)
    points = np.random.default_rng(0).uniform([-80.0, 300.0, 0.0], [80.0, 500.0, 100.0], (50, 3))
    for number, camera in enumerate(rig.cameras):
        found = camera.lens.project(transform(pose_of(camera), points))
        np.testing.assert_allclose(found, layout.project(points, number), atol=1e-9)
        assert np.linalg.det(pose_of(camera)[:3, :3]) < 0.0
    assert (rig.pictures, rig.unit_mm, rig.uncertainty) == ("as-is", 1.0, None)


def test_layouts_are_recognised() -> None:
    assert is_layout({"schema": "mirrorcam.layout/1"})
    assert not is_layout({"schema": "mirrorcam.dataset/1"})
    assert not is_layout([])
