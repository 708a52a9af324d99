"""COLMAP's files, read back by COLMAP, project as the layout does."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pycolmap

from mirrorcam.optics.geometry.transforms import transform
from tests.optics.camera_files.write.conftest import Case
from tests.optics.camera_files.write.read_back import assert_projects


def test_colmap_sparse_model(case: Case, folder: Path) -> None:
    model = pycolmap.Reconstruction(folder / "colmap" / "sparse")
    assert (len(model.rigs), len(model.frames)) == (1, 1)
    names = {image.name: image for image in model.images.values()}
    assert set(names) == {f"{view.name}/a.png" for view in case.views}
    for place, view in enumerate(case.views):
        image = names[f"{view.name}/a.png"]
        found = [image.project_point(point / 1000.0) for point in case.points_in_rig[place]]
        # COLMAP: the centre of the top-left pixel is (0.5, 0.5).
        assert_projects(np.array(found) - 0.5, case.flipped_px[place])
        assert not image.camera.has_bogus_params(0.1, 10.0, 1.0)
    reference = names[f"{case.views[case.layout.central_index].name}/a.png"]
    assert reference.is_ref_in_frame()


def test_colmap_would_drop_cropped_views(case: Case) -> None:
    """Why COLMAP gets whole frames: the principal point of some view lies outside its sub-image."""
    dropped = []
    for view in case.views:
        cut = view.cropped
        camera = pycolmap.Camera(model="PINHOLE", width=cut.width_px, height=cut.height_px)
        camera.params = [cut.fx_px, cut.fy_px, cut.cx_px + 0.5, cut.cy_px + 0.5]
        dropped.append(camera.has_bogus_params(0.1, 10.0, 1.0))
    assert any(dropped)


def test_colmap_rig_config(case: Case, folder: Path) -> None:
    (rig,) = pycolmap.read_rig_config(folder / "colmap" / "rig_config.json")
    reference = case.views[case.layout.central_index]
    # COLMAP takes the reference first, and nothing else does it take first.
    assert [camera.ref_sensor for camera in rig.cameras] == [True] + [False] * (len(case.views) - 1)
    assert rig.cameras[0].image_prefix == f"{reference.name}/"
    by_prefix = {camera.image_prefix: camera for camera in rig.cameras}
    for view, points_in_rig, pixels in zip(case.views, case.points_in_rig, case.flipped_px, strict=True):
        camera = by_prefix[f"{view.name}/"]
        points = transform(reference.camera_from_rig, points_in_rig)
        points = points / 1000.0
        if not camera.ref_sensor:
            points = np.array([camera.cam_from_rig * point for point in points])
        assert camera.camera is not None
        assert_projects(np.asarray(camera.camera.img_from_cam(points)) - 0.5, pixels)
