"""The picture of the device: from the front, the lens is visible in every mirror."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
import shapely

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.reference.device_bodies import Assembly, DeviceBody
from mirrorcam.render_scenes.reference.product_picture import product_picture, viewpoints
from tests.render_scenes.devices import box, write_glb


def level_from_rig(layout: Layout) -> FloatArray:
    """The rotation (3, 3) to the axes in which a device with level views stands."""
    right, down, forward = layout.view_from_rig
    return np.array([right, forward, -down])


def boxed(layout: Layout) -> dict[str, tuple[str, DeviceBody]]:
    """A device of a camera, a wall behind it, and plates of a millimetre where the layout's mirrors are."""
    pieces = {
        "camera": ("camera", box((-40.0, -12.0, -30.0), (40.0, 12.0, 5.0))),
        "mount": ("part", box((-60.0, -60.0, -40.0), (60.0, -55.0, 150.0))),
    }
    for index, mirror in enumerate(layout.mirrors):
        corners, count = mirror.outline_in_rig_mm, len(mirror.outline_in_rig_mm)
        fan = np.array([[0, k, k + 1] for k in range(1, count - 1)])
        body = DeviceBody("mirror", "mirror", corners, np.concatenate([fan, fan[:, ::-1]]), None, (0.9, 0.9, 0.9))
        pieces[f"mirror_{index}"] = ("mirror", body)
    return pieces


def test_the_lens_is_seen_in_every_mirror_from_the_front(default_layout: Layout) -> None:
    level, lean = level_from_rig(default_layout), np.deg2rad(20.0)
    leaning = np.array([[1, 0, 0], [0, np.cos(lean), -np.sin(lean)], [0, np.sin(lean), np.cos(lean)]]) @ level
    bodies = tuple(body for _, body in boxed(default_layout).values())
    upright = viewpoints(default_layout, Assembly(bodies, level))
    front, aside = viewpoints(default_layout, Assembly(bodies, leaning))
    # From the same place in front, whichever direction is up.
    np.testing.assert_allclose(front.eye_in_rig_mm, upright[0].eye_in_rig_mm)
    for mirror in default_layout.mirrors:
        way = mirror.virtual_centre_in_rig_mm - front.eye_in_rig_mm
        height, slope = front.eye_in_rig_mm @ mirror.normal_in_rig + mirror.distance_mm, way @ mirror.normal_in_rig
        at = front.eye_in_rig_mm - way * height / slope
        frame = mirror.rig_from_plane
        x, y = (at - frame[:3, 3]) @ frame[:3, :2]
        # With space for the pupil of 3 mm.
        assert shapely.contains_xy(shapely.Polygon(mirror.outline_in_plane_mm).buffer(-1.5), x, y)
    for view in (front, aside):
        np.testing.assert_allclose(view.axes @ view.axes.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(view.axes) == pytest.approx(1.0)
        assert view.axes[1] @ leaning[2] < -0.5  # up is up as the device stands
        assert abs(view.axes[0] @ leaning[2]) < 1e-9


def test_the_picture_shows_the_device_whole_and_nine_lenses(tmp_path: Path, default_layout: Layout) -> None:
    with pytest.raises(InputError, match=r"no assembly\.glb"):
        product_picture(default_layout, tmp_path, spp=1)
    write_glb(tmp_path / "assembly.glb", boxed(default_layout), level_from_rig(default_layout))
    fewer = default_layout.replaced(rows=1, mirrors=default_layout.mirrors[:3])
    with pytest.raises(InputError, match="parts of a different layout"):
        product_picture(fewer, tmp_path, spp=1)
    picture = product_picture(default_layout, tmp_path, spp=8, scale=0.25)
    assert picture.shape == (270, 480, 3)
    assert picture.dtype == np.uint8
    front, aside = picture[:, :239], picture[:, 241:]
    for half in (front, aside):
        rim = np.concatenate([half[:4].reshape(-1, 3), half[-4:].reshape(-1, 3), half[:, :4].reshape(-1, 3)])
        assert np.percentile(rim.min(axis=1), 5) > 100  # paper all around
        assert (half[..., 2] > 1.4 * half[..., 0]).mean() > 0.1  # the blue device in the middle
    # From the front, the dark spots above the camera are images of its lens in the mirrors.
    dark = cv2.morphologyEx((front[:150].max(axis=2) < 90).astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3)))
    _, _, stats, _ = cv2.connectedComponentsWithStats(cv2.erode(dark, np.ones((5, 5))))
    assert (stats[1:, cv2.CC_STAT_AREA] > 100).sum() == 9
