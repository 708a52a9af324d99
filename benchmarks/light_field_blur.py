"""Blur of few views, with and without views between them: `python -m benchmarks.light_field_blur SCENE...`.

SCENE: folders of the 4D Light Field Benchmark with an odd number of views a side, 2 n + 1. Every n-th and, where there
is one, every (n / 2)-th view is refocused, as they are and with views interpolated by measured depth, and compared with
all views refocused on the same plane. Planes lie at a quarter and three quarters of the disparities of the scene.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

from benchmarks.records import Rows, add_json_option, write_record
from mirrorcam.optics.light_field.io.formats.hci import read_hci
from mirrorcam.optics.light_field.light_field import LightField
from mirrorcam.optics.light_field.render.perspective import part_of, with_views_between
from mirrorcam.optics.light_field.render.refocusing import FocalPlane, RenderedPicture, aperture, refocus
from mirrorcam.optics.light_field.render.view_depths import ViewDepths

BORDER_PX = 15


def psnr(picture: RenderedPicture, true: RenderedPicture) -> float:
    """Peak signal-to-noise ratio of pictures within their borders."""
    inner = slice(BORDER_PX, -BORDER_PX)
    return float(-10.0 * np.log10(np.square(picture.image - true.image)[inner, inner].mean()))


def compare(folder: Path, rows: Rows) -> None:
    """Add a row for each part of the views and each plane."""
    scene = read_hci(folder)
    many = scene.light_field
    near, far = scene.depth_range_mm or (None, None)
    low, high = scene.disparity_range_px or (-2.0, 2.0)
    middle = many.rows // 2
    for step in (each for each in (middle, middle // 2) if each > 1):
        every = slice(0, many.rows, step)
        few: LightField = part_of(many, every, every)
        start = time.process_time()
        depths = ViewDepths.measured(few, near_mm=near, far_mm=far)
        measured = time.process_time()
        dense = with_views_between(few, depths, step - 1)
        spent = measured - start, time.process_time() - measured
        for share in (0.25, 0.75):
            plane = FocalPlane.at_depth(many, float(many.depth_mm_from_disparity(low + share * (high - low))))
            true = refocus(many, plane)
            plain, soft = refocus(few, plane), refocus(few, plane, view_weights=aperture(few))
            reached = (psnr(each, true) for each in (plain, soft, refocus(dense, plane)))
            shown = (f"{value:.1f}" for value in (*reached, *spent))
            rows.add(folder.name, f"{few.cols} x {few.rows}", f"{share:.2f}", *shown)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+", type=Path, metavar="SCENE")
    add_json_option(parser)
    options = parser.parse_args()
    found = Rows("scene", "views", "plane", "views, dB", "weighted, dB", "between, dB", "s, depth", "s, between")
    for each in options.scenes:
        compare(each, found)
    write_record(options.json, "light_field_blur", table=found.table)
