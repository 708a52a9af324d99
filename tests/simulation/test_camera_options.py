"""Short texts of options become tolerances and sensors, or are refused in one line."""

from __future__ import annotations

from typing import get_args

import pytest

from mirrorcam.cad.plan.back_table import BACKS
from mirrorcam.core.console.option_texts import AdapterKind
from mirrorcam.core.values import InputError
from mirrorcam.optics.geometry.tolerances import Tolerances
from mirrorcam.render_scenes.settings import SENSORS
from mirrorcam.simulation.camera_options import sensor_from_text, tolerances_from_text


def test_texts_become_tolerances_and_sensors() -> None:
    assert tolerances_from_text("") == Tolerances()
    assert tolerances_from_text("none") == Tolerances.none()
    assert tolerances_from_text("tilt_deg=0.5,centre_px=2") == Tolerances(tilt_deg=0.5, centre_px=2.0)
    assert sensor_from_text("poor") == SENSORS["poor"]


def test_a_text_that_is_none_is_refused() -> None:
    with pytest.raises(InputError, match="--as-built tilt: no such tolerance, expected tilt_deg"):
        tolerances_from_text("tilt=1")
    with pytest.raises(InputError, match="--as-built tilt_deg=wide: "):
        tolerances_from_text("tilt_deg=wide")
    with pytest.raises(InputError, match="--sensor 'film': expected "):
        sensor_from_text("film")


def test_the_adapters_are_the_backs_that_there_are() -> None:
    assert get_args(AdapterKind) == tuple(BACKS)
