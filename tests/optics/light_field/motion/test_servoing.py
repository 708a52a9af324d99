"""The interaction matrix is the derivative of the features, and the velocity leads to the taught view."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.transforms import inverse, rigid, transform
from mirrorcam.optics.light_field.motion.servoing import Matches, interaction, servo_velocity


@pytest.fixture(scope="module")
def points_mm() -> FloatArray:
    random = np.random.default_rng(4)
    return np.column_stack([random.uniform(-80, 80, (60, 2)), random.uniform(300, 600, 60)])


def seen(points_mm: FloatArray) -> FloatArray:
    """Return x, y and w of points in view axes."""
    return np.column_stack([points_mm[:, :2] / points_mm[:, 2:], 1.0 / points_mm[:, 2]])


def moved(velocity: FloatArray, time_s: float) -> FloatArray:
    """Return the pose of the view after it moved with a velocity for a short time."""
    return rigid(Rotation.from_rotvec(velocity[3:] * time_s).as_matrix(), velocity[:3] * time_s)


@pytest.mark.parametrize("axis", range(6))
def test_the_interaction_matrix_is_the_derivative_of_the_features(points_mm: FloatArray, axis: int) -> None:
    velocity = np.eye(6)[axis] * (100.0 if axis < 3 else 1.0)
    step = 1e-6
    later, earlier = (seen(transform(inverse(moved(velocity, time)), points_mm)) for time in (step, -step))
    np.testing.assert_allclose(interaction(seen(points_mm)) @ velocity, (later - earlier) / (2 * step), atol=1e-7)


def test_the_velocity_leads_to_the_taught_view(points_mm: FloatArray) -> None:
    pose = rigid(Rotation.from_euler("xyz", [8, -6, 20], degrees=True).as_matrix(), np.array([50.0, -30.0, -80.0]))
    taught, distances = seen(points_mm), []
    for _ in range(60):
        matches = Matches(seen(transform(inverse(pose), points_mm)), taught, np.full((60, 3), [1e-3, 1e-3, 1e-5]))
        distances.append(float(np.linalg.norm(pose[:3, 3])))
        pose = pose @ moved(servo_velocity(matches), 0.3)
    assert all(later < earlier for earlier, later in pairwise(distances))
    np.testing.assert_allclose(pose, np.eye(4), atol=1e-4)
    assert matches.rms_error < 1e-6
