"""Settings of lasers: those of the source, and the energy that a user of another forum reports."""

from __future__ import annotations

import pytest

from mirrorcam.cad.mirrors.laser_settings import laser_settings


def test_the_settings_for_3_mm_are_those_of_the_source() -> None:
    (half, full, more) = laser_settings(3.0)
    assert (full.tube_w, full.percent, full.mm_per_s) == (60, "65 to 75", "10 to 15")
    assert (half.tube_w, half.mm_per_s) == (40, "5 to 7.5")
    assert (more.tube_w, more.mm_per_s) == (80, "13 to 20")
    # The source has 5 to 8 mm/s with 85 to 95 % for 6 mm.
    assert laser_settings(6.0)[1][1:] == ("85 to 95", "5 to 7.5")


def test_another_user_cuts_with_as_much_energy_per_length() -> None:
    """80 W at 80 % and 25 mm/s cut 3 mm (LightBurn's forum, topic 12728)."""
    _, _, setting = laser_settings(3.0)
    percent, speed = float(setting.percent.split()[0]), float(setting.mm_per_s.split()[-1])
    assert percent / 100.0 * setting.tube_w / speed == pytest.approx(0.8 * 80.0 / 25.0, rel=0.1)
