"""Errors of features beside what they say of themselves: `python -m benchmarks.light_field_feature_sigma [FOLDER...]`.

Of rendered matte reliefs, rough and mild, in good light and little, seen by 3x3, 5x5 and 9x9 views of the same reach;
and of scenes in the HCI benchmark's format that have the true disparity of the central view. Prints the number of
features, how many are flagged as refracted (none should be), the median of |error| / sigma (of a Gaussian: 0.67), how
many are beyond 3 sigma, and the median error in px over the whole reach of the views; of features away from depth
edges, with those at edges in brackets.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates, maximum_filter

from benchmarks.records import SIGMA, TIMES, add_json_option, table, write_record
from benchmarks.relief_scene import Relief, even_views, light_field_of
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.features import DetectorName, FeatureFinder, Features
from mirrorcam.optics.light_field.io.formats.hci import read_hci
from mirrorcam.optics.light_field.light_field import LightField

DETECTORS: tuple[DetectorName, ...] = ("SIFT", "ORB")
REACH_MM = 20.0
RELIEFS = {
    "mild": (Relief(), 1.0),
    "rough": (Relief(heights_mm=((5.0, 5.0), (32.0, 30.0))), 1.0),
    "plaster": (Relief(heights_mm=((4.0, 4.0), (12.0, 8.0), (32.0, 30.0)), contrast=3.0), 0.5),
    "dim": (Relief(), 5.0),
}
# Disparity that bends by more from pixel to pixel, in px over the reach of the views, is an edge; and how far from it
# a feature of the finest scale is to be.
EDGE_PX, CLEAR_PX = 0.3, 7
TABLED = (3, 9)
"""Numbers of views, along a side, of the table."""


def errors_px(features: Features, true_px: FloatArray) -> FloatArray:
    """Errors (n,) of disparities against the true ones (v, u)."""
    return features.disparity_px - map_coordinates(true_px, features.pixels.T[::-1], order=1)


def at_edges(features: Features, true_px: FloatArray, steps: int) -> NDArray[np.bool_]:
    """Whether depth edges are near features (n,), for how coarse they are."""
    known = np.nan_to_num(true_px, nan=1e3) * steps
    bend = np.zeros_like(known)
    bend[1:-1] = np.abs(np.diff(known, 2, axis=0))
    bend[:, 1:-1] = np.maximum(bend[:, 1:-1], np.abs(np.diff(known, 2, axis=1)))
    u, v = np.rint(features.pixels).astype(np.int64).T
    level = np.clip(np.rint(np.log2(features.scale_px / 2.0)), 0, 3).astype(np.int64)
    near = np.array([(maximum_filter(bend, 2 * CLEAR_PX * 2**each + 1) > EDGE_PX)[v, u] for each in range(4)])
    return np.take_along_axis(near, level[None], axis=0)[0]


@dataclass(frozen=True)
class Errors:
    """Of some features: their number, flagged, median |error| / sigma, beyond 3 sigma, error in px over the reach."""

    count: int
    flagged_percent: float
    ratio: float
    beyond_percent: float
    reach_px: float

    def __str__(self) -> str:
        return (
            f"{self.count:5} {self.flagged_percent:6.1f} % {self.ratio:6.2f} {self.beyond_percent:6.1f} % "
            f"{self.reach_px:8.4f}"
        )


def errors_of(
    light_field: LightField, true_px: FloatArray, name: DetectorName, depths_mm: tuple[float, float] | None
) -> tuple[Errors | None, Errors | None]:
    """Of features away from depth edges, and at edges; None where there are none."""
    near, far = depths_mm or (None, np.inf)
    features = FeatureFinder(light_field, name, nearest_mm=near, farthest_mm=far).find(light_field)
    steps = light_field.cols - 1
    edge = at_edges(features, true_px, steps)
    off = np.abs(errors_px(features, true_px))
    ratio = off / features.disparity_sigma_px

    def of(chosen: NDArray[np.bool_]) -> Errors | None:
        if not chosen.any():
            return None
        return Errors(
            count=int(chosen.sum()),
            flagged_percent=100.0 * float(features.refracted[chosen].mean()),
            ratio=float(np.median(ratio[chosen])),
            beyond_percent=100.0 * float(np.mean(ratio[chosen] > 3)),
            reach_px=steps * float(np.median(off[chosen])),
        )

    return of(~edge), of(edge)


def described(found: tuple[Errors | None, Errors | None]) -> str:
    """A line of them."""
    clear, edge = found
    return f"{clear or 'none'}" + (f"   ({edge})" if edge else "")


def cells(each: list[Errors]) -> tuple[str, ...]:
    """A row of the table, of all detectors."""
    return (
        "; ".join(f"{one.flagged_percent:.1f}" for one in each) + " %",
        "; ".join(f"{one.ratio:.2f}" for one in each),
        "; ".join(f"{one.beyond_percent:.1f}" for one in each) + " %",
        "; ".join(f"{one.reach_px:.3f}" for one in each),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="*", type=Path, metavar="FOLDER")
    add_json_option(parser)
    given = parser.parse_args()
    rows: list[tuple[str, ...]] = []
    print(f"{'':34}{'n':>5} {'flagged':>8} {'|e|/s':>6} {'> 3 s':>8} {'error px':>8}")
    for title, (scene, noise_grey) in RELIEFS.items():
        for count in (3, 5, 9):
            views = even_views(count, REACH_MM / (count - 1))
            light_field, true_mm = light_field_of(scene, views, noise_grey=noise_grey)
            clear = []
            for name in DETECTORS:
                found = errors_of(light_field, views.disparity_px_from_depth(true_mm), name, None)
                print(f"{f'{title} {count}x{count} {name}':34}{described(found)}")
                clear += [found[0]] if found[0] else []
            if count in TABLED and len(clear) == len(DETECTORS):
                rows.append((f"{title}: {count} {TIMES} {count}", *cells(clear)))
    head = ("flagged as refracted", f"median error/{SIGMA}", f"beyond 3 {SIGMA}", "median error over the reach, px")
    write_record(given.json, "light_field_feature_sigma", table=table(("; ".join(DETECTORS), *head), rows))
    for folder in given.folders:
        whole = read_hci(folder)
        for every in [every for every in (4, 2, 1) if (whole.light_field.cols // 2) % every == 0]:
            scene_of = read_hci(folder, every=every)
            views_of = scene_of.light_field
            if scene_of.disparity_px is None:
                parser.error(f"{folder}: no true disparity")
            for name in DETECTORS:
                title = f"{folder.name} {views_of.rows}x{views_of.cols} {name}"
                true_px = scene_of.disparity_px.astype(np.float64)
                print(f"{title:34}" + described(errors_of(views_of, true_px, name, scene_of.depth_range_mm)))


if __name__ == "__main__":
    main()
