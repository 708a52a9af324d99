"""The expected frame of the live camera, against rays from the pupil to the device."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from shapely import Polygon, contains_xy

from mirrorcam.cad.checks.exported_mesh import solid_of
from mirrorcam.cad.guide.live_view import (
    LINE_RGB,
    MIRROR,
    SURROUNDINGS,
    _draw_name,
    live_overlay,
    live_view,
    write_live_view,
)
from tests.cad.guide.conftest import Made

FAR_MM = 1000.0


def test_every_pixel_shows_what_its_ray_meets(made: Made) -> None:
    """Rays against the meshes, with the camera's distortion, at random pixels away from edges and names."""
    layout = made.device.layout
    camera = layout.camera
    image = live_view(layout, made.components)
    assert image.shape == (camera.height_px, camera.width_px, 3)
    random = np.random.default_rng(3)
    pixels = random.uniform((20.0, 20.0), (camera.width_px - 20.0, camera.height_px - 20.0), (1500, 2))
    around = np.stack([cv2.erode(image[..., 0], np.ones((9, 9))), cv2.dilate(image[..., 0], np.ones((9, 9)))], axis=-1)
    rays = camera.unproject(pixels)
    parts = [solid_of(component.mesh) for component in made.components if component.kind == "part"]
    outlines = [Polygon(mirror.usable_normalized) for mirror in layout.mirrors]
    seen = {"mirror": 0, "part": 0, "around": 0}
    for pixel, ray in zip(np.round(pixels).astype(int), rays, strict=True):
        low, high = around[pixel[1], pixel[0]]
        if int(high) - int(low) > 20:
            continue
        if any(contains_xy(outline, ray[0], ray[1]) for outline in outlines):
            kind, expected = "mirror", low == high == MIRROR
        elif any(part.ray_cast(np.zeros(3), ray * FAR_MM) for part in parts):
            kind, expected = "part", high < 0.5 * MIRROR
        else:
            kind, expected = "around", low == high == SURROUNDINGS
        assert expected, (kind, pixel, low, high)
        seen[kind] += 1
    assert seen["mirror"] > 500
    assert seen["part"] > 20


def test_the_overlay_is_clear_but_for_outlines_and_names(made: Made) -> None:
    layout = made.device.layout
    overlay = live_overlay(layout)
    drawn = overlay[..., 3] > 0
    assert 0.002 < drawn.mean() < 0.1
    assert (overlay[drawn][:, :3] == LINE_RGB[::-1]).mean() > 0.5
    corners = layout.outline_px(0)
    far = np.array([layout.camera.width_px, layout.camera.height_px]) - 6.0
    inside = corners[((corners > 5.0) & (corners < far)).all(axis=1)]
    assert len(inside) > 10
    for x, y in np.round(inside).astype(int):
        assert drawn[y - 3 : y + 4, x - 3 : x + 4].any()


def test_files_have_the_size_of_the_frame_and_the_same_bytes(made: Made, tmp_path: Path) -> None:
    for name in ("one", "other"):
        write_live_view(tmp_path / name, made.device.layout, made.components)
    for stem in ("live_view", "live_overlay"):
        one, other = (tmp_path / name / "pictures" / f"{stem}.png" for name in ("one", "other"))
        assert one.read_bytes() == other.read_bytes()
    overlay = cv2.imread(str(tmp_path / "one" / "pictures" / "live_overlay.png"), cv2.IMREAD_UNCHANGED)
    assert overlay is not None
    camera = made.device.layout.camera
    assert overlay.shape == (camera.height_px, camera.width_px, 4)


def test_a_layout_alone_shows_its_mirrors(made: Made) -> None:
    image = live_view(made.device.layout, ())
    assert set(np.unique(image[..., 0])) >= {SURROUNDINGS, MIRROR}


def test_names_in_a_frame_of_twice_the_size_are_twice_as_large() -> None:
    heights = []
    for scale in (1, 2):
        image = np.zeros((1080 * scale, 1920 * scale, 3), dtype=np.uint8)
        _draw_name(
            image, "1-0", scale * np.array([[100.0, 100.0], [900.0, 100.0], [900.0, 520.0], [100.0, 520.0]]), (255,) * 3
        )
        heights.append(np.ptp(np.nonzero(image.any(axis=2))[0]))
    assert 1.9 < heights[1] / heights[0] < 2.1
