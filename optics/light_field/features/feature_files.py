"""Features as files: all of them as NumPy's .npz, a table of their numbers as CSV."""

from __future__ import annotations

import csv
from dataclasses import fields
from pathlib import Path

import numpy as np

from mirrorcam.core.disk.files import atomic, write_npz
from mirrorcam.optics.light_field.features.feature_set import Features

COLUMNS = (
    *("u_px", "v_px", "scale_px", "depth_mm", "depth_sigma_mm", "x_rig_mm", "y_rig_mm", "z_rig_mm"),
    *("disparity_px", "disparity_sigma_px", "residual_px", "views"),
    *("disparity_along_s_px", "disparity_along_t_px", "two_slope_sigma", "refracted"),
)


def save_npz(path: Path, features: Features) -> None:
    """Write the fields of features to an .npz file, atomically; the same features give the same bytes."""
    write_npz(path, {field.name: getattr(features, field.name) for field in fields(features)})


def save_csv(path: Path, features: Features) -> None:
    """Write a table with one line per feature, atomically; an unknown value is an empty cell."""
    numbers = np.column_stack(
        [
            features.pixels,
            features.scale_px,
            features.depth_mm,
            features.depth_sigma_mm,
            features.points_in_rig_mm,
            features.disparity_px,
            features.disparity_sigma_px,
            features.residual_px,
            features.seen.sum(axis=(1, 2)),
            features.apart_disparity_px,
            features.two_slope_sigma,
            features.refracted,
        ]
    )
    with atomic(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(COLUMNS)
        for row in numbers:
            table.writerow(["" if np.isnan(number) else f"{number:.8g}" for number in row])
