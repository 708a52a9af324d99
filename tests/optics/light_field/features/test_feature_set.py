"""Features as a value: read-only arrays of one length."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mirrorcam.optics.light_field.features.feature_set import Features


def made(count: int, **changes: Any) -> Features:
    """Features of a grid of 3 x 3 views, with zeros for all that is known of them."""
    shapes: dict[str, tuple[int, ...]] = {
        "pixels": (2,),
        "scale_px": (),
        "disparity_px": (),
        "disparity_sigma_px": (),
        "points_in_rig_mm": (3,),
        "depth_mm": (),
        "depth_sigma_mm": (),
        "residual_px": (),
        "seen_px": (3, 3, 2),
        "apart_disparity_px": (2,),
        "two_slope_sigma": (),
    }
    arrays: dict[str, Any] = {name: np.zeros((count, *shape)) for name, shape in shapes.items()}
    seen = np.ones((count, 3, 3), dtype=bool)
    arrays |= {"seen": seen, "refracted": seen[:, 0, 0], "descriptors": np.zeros((count, 4), dtype=np.uint64)}
    return Features(detector="ORB", layout_identity="0123456789abcdef", **(arrays | changes))


def test_features_are_as_many_as_their_pixels() -> None:
    assert len(made(5)) == 5
    assert len(made(0)) == 0


def test_arrays_are_read_only_and_those_given_stay_writable() -> None:
    given = np.ones(5)
    with pytest.raises(ValueError, match="read-only"):
        made(5, depth_mm=given).depth_mm[0] = 1.0
    given[0] = 2.0


@pytest.mark.parametrize("name", ["depth_mm", "seen", "descriptors"])
def test_arrays_of_another_length_are_refused(name: str) -> None:
    with pytest.raises(ValueError, match=f"{name} has shape .*, expected 5 features"):
        made(5, **{name: getattr(made(4), name)})
