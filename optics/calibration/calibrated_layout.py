"""The layout of an estimate: its camera, and the nominal mirrors moved to the planes that were found."""

from __future__ import annotations

import numpy as np

from mirrorcam.core.bounds import LENGTH_MM
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.solver.residuals import Estimate
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror


def as_estimated(layout: Layout, estimate: Estimate) -> Layout:
    """A nominal layout with the camera, planes, plates and curvatures of an estimate, without figures.

    A plate that comes out as none, which an alarm says, is as thin as a layout can have it.
    """
    thickness_mm = np.maximum(estimate.thickness_mm, LENGTH_MM.least)
    mirrors = tuple(
        moved_to(mirror, centre).replaced(
            thickness_mm=thickness if mirror.is_second_surface else mirror.thickness_mm, curvature_per_m=curvature
        )
        for mirror, centre, thickness, curvature in zip(
            layout.mirrors,
            estimate.virtual_centres_in_rig_mm,
            thickness_mm.tolist(),
            estimate.curvature_per_m,
            strict=True,
        )
    )
    return layout.replaced(kind="calibrated", camera=estimate.camera, mirrors=mirrors, metrics={}, verdict={})


def moved_to(mirror: Mirror, virtual_centre: FloatArray) -> Mirror:
    """The mirror as a rigid body, moved the shortest way (tilt, then shift along the normal) to a measured plane."""
    normal = -virtual_centre / np.linalg.norm(virtual_centre)
    axis = np.cross(mirror.normal_in_rig, normal)
    cosine = float(mirror.normal_in_rig @ normal)
    # Rodrigues' formula with sine and axis in one vector; the planes are never opposite.
    skew = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    rotation = np.eye(3) + skew + skew @ skew / (1.0 + cosine)
    middle = mirror.outline_in_rig_mm.mean(axis=0)
    distance = float(np.linalg.norm(virtual_centre)) / 2.0
    return mirror.moved(rotation, (-distance - normal @ middle) * normal)
