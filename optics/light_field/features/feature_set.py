"""The features of a light field: positions in the views, slopes, depths and descriptors; and their files."""

from __future__ import annotations

import csv
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.disk.files import atomic, write_npz
from mirrorcam.core.values import FloatArray

COLUMNS = (
    *("u_px", "v_px", "scale_px", "depth_mm", "depth_sigma_mm", "x_rig_mm", "y_rig_mm", "z_rig_mm"),
    *("disparity_px", "disparity_sigma_px", "residual_px", "views"),
    *("disparity_along_s_px", "disparity_along_t_px", "two_slope_sigma", "refracted"),
)


@dataclass(frozen=True, eq=False, kw_only=True)
class Features:
    """Features (n) of one light field, in the order of their keypoints; arrays are read-only.

    Attributes
    ----------
    detector
        Name of the detector.
    pixels
        Pixels (n, 2), (u, v), of the fit over all views, in the reference view.
    keypoint_px
        Pixels (n, 2) of the keypoint that the descriptor describes; `pixels` are near it, where gradients tell depth.
    scale_px
        Scale (n,) at which the keypoint was detected; 1 is the finest.
    disparity_px
        Slope -du/ds (n,) fitted to all views, px per mean step along s (along t for a single column of views), positive
        in front of the reference plane.
    disparity_sigma_px
        Standard deviation (n,) of the disparity.
    points_in_rig_mm
        Points (n, 3) in the rig frame.
    depth_mm
        Depth (n,) from the pupil along view z.
    depth_sigma_mm
        Standard deviation (n,) of the depth.
    residual_px
        RMS distance (n,) between detected and fitted pixels over the views.
    seen
        Mask (n, t, s) of the views in which each feature was detected, including the reference view.
    seen_px
        Pixels (n, t, s, 2) at which each feature was detected; NaN if it was not.
    apart_disparity_px
        Slopes (n, 2) along s and t, estimated separately, in the unit of `disparity_px` (both per mean step of the same
        axis, so they are equal for a point); NaN if the views are collinear or too few.
    two_slope_sigma
        Difference (n,) of the two principal slopes in standard deviations, from patches of two sizes; NaN if unknown.
    refracted
        Mask (n,) of features whose difference exceeds the finder's limit: they are seen in a curved mirror or through a
        refracting surface, so their depth does not belong to a surface at their pixel.
    descriptors
        Descriptors (n, d) in the reference view: bits as uint64 words, or RootSIFT as float32.
    layout_identity
        `Layout.identity` of the light field.
    """

    detector: str
    pixels: FloatArray
    keypoint_px: FloatArray
    scale_px: FloatArray
    disparity_px: FloatArray
    disparity_sigma_px: FloatArray
    points_in_rig_mm: FloatArray
    depth_mm: FloatArray
    depth_sigma_mm: FloatArray
    residual_px: FloatArray
    seen: NDArray[np.bool_]
    seen_px: FloatArray
    apart_disparity_px: FloatArray
    two_slope_sigma: FloatArray
    refracted: NDArray[np.bool_]
    descriptors: NDArray[Any]
    layout_identity: str

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if isinstance(value, np.ndarray):
                if len(value) != len(self.pixels):
                    raise ValueError(f"{name} has shape {value.shape}, expected {len(self.pixels)} features")
                read_only = value.view()
                read_only.flags.writeable = False
                object.__setattr__(self, name, read_only)

    def __len__(self) -> int:
        return len(self.pixels)


def save_features(path: Path, features: Features) -> None:
    """Write the fields of features to an .npz file, atomically; equal features give equal bytes."""
    write_npz(path, {field.name: getattr(features, field.name) for field in fields(features)})


def save_csv(path: Path, features: Features) -> None:
    """Write a table with one line per feature, atomically; unknown values are empty cells."""
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
