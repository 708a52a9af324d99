"""Refocusing a tabletop scene photographed through uneven mirrors as built, against a pinhole's picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from mirrorcam.core.images.pictures import read_image
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.optics.light_field.equalisation import measure
from mirrorcam.optics.light_field.light_field import LightField
from mirrorcam.optics.light_field.render.refocusing import FocalPlane, homography, refocus
from mirrorcam.render_scenes.settings import SENSORS
from mirrorcam.render_scenes.tabletop.tabletop_set import MASK, TabletopRequest, TabletopSet, read_map, render_tabletop

SOFTNESS_PX = 0.95
IN_FOCUS_PX = 0.25


def psnr(image: NDArray[Any], true: NDArray[Any], where: NDArray[np.bool_]) -> float:
    """Return the peak signal-to-noise ratio of pictures (v, u, c), 0 to 255."""
    return float(10.0 * np.log10(255.0**2 / np.mean(np.square(image - true)[where])))


def true_view(folder: Path, t: int, s: int) -> NDArray[np.float64]:
    """Return the picture (v, u, c) of a pinhole at a view, blurred like lens and lookup."""
    view = read_image(folder / f"truth/views/{t}_{s}.png").astype(np.float64)
    return np.asarray(cv2.GaussianBlur(view, (0, 0), SOFTNESS_PX))


def in_focus_everywhere(folder: Path, light_field: LightField, depth_mm: float) -> NDArray[np.bool_]:
    """Mask (v, u) of the central view: pixels of matte objects on the plane at a depth that every view shows."""
    t, s = TabletopSet.load(folder).central_view
    plane = FocalPlane.at_depth(light_field, depth_mm)
    size = light_field.width_px, light_field.height_px
    where = read_image(folder / f"truth/mask/{t}_{s}.png", grey=True) == MASK["matte"]
    reach_mm = np.abs(light_field.positions_mm[..., :2]).max()
    for index in np.ndindex(light_field.rows, light_field.cols):
        depth = read_map(folder / f"truth/depth/{index[0]}_{index[1]}.exr", "depth")
        off_px = reach_mm * (light_field.slope_from_depth(depth) - light_field.slope_from_depth(depth_mm))
        blurred = (~(np.abs(off_px) <= IN_FOCUS_PX) | ~light_field.valid[index]).astype(np.float32)
        matrix = homography(light_field, index, plane)
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        where &= np.asarray(cv2.warpPerspective(blurred, matrix, size, flags=flags, borderValue=1.0)) == 0
    return where


def decoded(folder: Path) -> LightField:
    """The decoded frame of a tabletop set, by the layout as built, with views of equal brightness."""
    decoder = Decoder(Layout.load(folder / "truth/layout.json"))
    frame = read_image(folder / TabletopSet.load(folder).frame_name)
    return decoder.equalised(measure([decoder.decode(frame)])).decode(frame)


@pytest.mark.slow
def test_a_plane_in_focus_is_within_35_db_of_the_pinhole(default_layout: Layout, tmp_path: Path) -> None:
    manifest = render_tabletop(
        TabletopRequest(layout=default_layout, seed=2, spp=16, sensor=SENSORS["ideal"]), tmp_path
    )
    light_field = decoded(tmp_path)
    t, s = manifest.central_view
    true = true_view(tmp_path, t, s)
    for depth_mm in (375.0, 600.0):
        where = in_focus_everywhere(tmp_path, light_field, depth_mm)
        assert where.sum() > 1000
        plane = FocalPlane.at_depth(light_field, depth_mm)
        assert psnr(refocus(light_field, plane).image * 255.0, true, where) > 35.0
        assert psnr(refocus(light_field, plane, combine="median").image * 255.0, true, where) > 35.0
        assert psnr(refocus(light_field, FocalPlane.at_depth(light_field, 300.0)).image * 255.0, true, where) < 30.0
    # With views assumed on the nearest even grid, only the reference plane is sharp.
    even = LightField.of(light_field.on_regular_grid(), light_field.samples, light_field.weights)
    assert psnr(refocus(even, plane).image * 255.0, true, where) < 35.0
