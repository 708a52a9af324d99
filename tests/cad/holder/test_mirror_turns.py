"""Turns of screws: what they do to a mirror, and back; against rigid motions and closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.cad.holder.mirror_turns import (
    PITCH_MM,
    centre_after,
    rig_from_carrier,
    rotation_about,
    tilt_and_shift,
    travel_turns,
    turn_deg,
    turns_to,
)
from tests.cad.holder.screwed import pair, planned

CARRIERS = list(zip(pair().mirrors, planned().carriers, strict=True))


def test_turning_all_screws_alike_draws_a_mirror_straight_to_the_holder() -> None:
    for mirror, carrier in CARRIERS:
        motion = rig_from_carrier(carrier, np.array([0.4, 0.4, 0.4]))
        assert np.allclose(motion[:3, :3], np.eye(3))
        assert np.allclose(motion[:3, 3], 0.4 * PITCH_MM * carrier.rig_from_back[:3, 2])
        moved = centre_after(mirror.virtual_centre_in_rig_mm, carrier, np.array([0.4, 0.4, 0.4]))
        along = -mirror.normal_in_rig @ carrier.rig_from_back[:3, 2]
        assert tilt_and_shift(moved, mirror.virtual_centre_in_rig_mm) == pytest.approx((0.0, 0.4 * PITCH_MM * along))


def test_one_screw_tilts_by_the_pitch_over_its_height() -> None:
    for mirror, carrier in CARRIERS:
        tilts = []
        for turns in np.eye(3):
            moved = centre_after(mirror.virtual_centre_in_rig_mm, carrier, turns)
            tilts.append(tilt_and_shift(moved, mirror.virtual_centre_in_rig_mm)[0])
        # The mirror is not level with the back, so that its normal turns by a little less.
        assert 0.9 * turn_deg(carrier) < max(tilts) <= 1.001 * turn_deg(carrier)


@pytest.mark.parametrize("seed", range(5))
def test_known_turns_are_found_from_the_planes_alone(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for mirror, carrier in CARRIERS:
        turns = rng.uniform(-1.0, 1.0, 3)
        moved = centre_after(mirror.virtual_centre_in_rig_mm, carrier, turns)
        assert turns_to(mirror.virtual_centre_in_rig_mm, moved, carrier) == pytest.approx(turns, abs=1e-9)


def test_a_mirror_tilted_by_a_degree_comes_back_to_its_design() -> None:
    """From any plane: the turns that are found, done, give the wanted plane."""
    rng = np.random.default_rng(7)
    for mirror, carrier in CARRIERS:
        wanted = mirror.virtual_centre_in_rig_mm
        axis = rng.normal(size=3)
        turned = rotation_about(axis / np.linalg.norm(axis), np.radians(1.0))
        measured = 1.004 * turned @ wanted
        turns = turns_to(measured, wanted, carrier)
        assert np.abs(centre_after(measured, carrier, turns) - wanted).max() < 1e-9
        assert np.abs(turns).max() < 3.0
        assert turns_to(wanted, wanted, carrier) == pytest.approx(np.zeros(3), abs=1e-9)


def test_the_travel_is_in_turns_of_the_thread() -> None:
    screw = planned().adjuster
    assert travel_turns(screw) * 0.5 == pytest.approx(screw.travel_mm)
