"""Figures of the default design that documents state: `python -m benchmarks.default_layout [--json FILE]`.

Of tests/data/default_layout.json: how far normals of mirrors are from their mean, and how far from an edge of a mirror
in the frame only part of the pupil sees the scene in that mirror.
"""

from __future__ import annotations

import argparse

import numpy as np

from benchmarks.records import ROOT, add_json_option, write_record
from mirrorcam.optics.geometry.layout import Layout

LAYOUT = ROOT / "tests" / "data" / "default_layout.json"


def normals_from_mean_deg(layout: Layout) -> float:
    """The largest angle of a mirror's normal to the mean of all."""
    normals = np.array([-each / np.linalg.norm(each) for each in layout.virtual_centres_in_rig_mm])
    mean = normals.mean(axis=0) / np.linalg.norm(normals.mean(axis=0))
    return float(np.degrees(np.arccos(normals @ mean)).max())


def faded_px(layout: Layout) -> tuple[float, float]:
    """On either side of edges, the least and the largest width in which part of the pupil sees the scene in the mirror.

    At the depth d along the camera's axis it is f r |1/d - 1/focus| of a pupil with the radius r.
    """
    camera = layout.camera
    depth_mm = np.concatenate([mirror.outline_in_rig_mm[:, 2] for mirror in layout.mirrors])
    width_px = camera.fx_px * 0.5 * camera.aperture_mm * np.abs(1.0 / depth_mm - 1.0 / camera.focus_mm)
    return float(width_px.min()), float(width_px.max())


def main() -> None:
    """Print the figures, write the record."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_json_option(parser)
    options = parser.parse_args()
    layout = Layout.load(LAYOUT)
    least, most = faded_px(layout)
    values = {"normals_from_mean_deg": normals_from_mean_deg(layout), "faded_least_px": least, "faded_most_px": most}
    for name, value in values.items():
        print(f"{name} {value:.2f}")
    write_record(options.json, "default_layout", values)


if __name__ == "__main__":
    main()
