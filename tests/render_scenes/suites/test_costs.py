"""Costs that are said beforehand: laws here; `tests/bench/test_suite_command.py` compares them with real ones."""

from __future__ import annotations

import pytest

from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.render_scenes.suites.costs import START_S, Cost, design_seconds, elapsed_s, set_cost, slowness
from mirrorcam.render_scenes.suites.recipe import SetRecipe


def cost(**stated: object) -> Cost:
    return set_cost(SetRecipe.model_validate({"name": "one"} | stated))


def test_pictures_are_those_of_the_set() -> None:
    assert cost(frames=7, base_frames=3).pictures == 10


@pytest.mark.parametrize(
    "more",
    [
        {"frames": 40},
        {"renderer": "mitsuba"},
        {"maps": True},
        {"sensor": "webcam"},
        {"design": {"camera": "brio"}},
        {"design": {"rows": 5, "cols": 5}},
    ],
)
def test_more_work_takes_longer(more: dict[str, object]) -> None:
    assert cost(**more).seconds > 1.1 * cost().seconds


def test_time_and_size_beyond_those_of_any_set_grow_with_the_pixels() -> None:
    whole, half, quarter = (cost(frames=100, design={"rows": 1, "cols": 2}, binned=b) for b in (1.0, 0.5, 0.25))
    for name in ("seconds", "stored_bytes"):
        steps = [getattr(a, name) - getattr(b, name) for a, b in ((whole, half), (half, quarter))]
        assert steps[0] == pytest.approx(4.0 * steps[1])


def test_size_follows_the_compression() -> None:
    sizes = [cost(sensor=sensor).stored_bytes for sensor in ("poor", "c920", "ideal")]
    assert sizes == sorted(sizes)
    assert cost(maps=True).stored_bytes > 5 * cost().stored_bytes


def test_workers_share_the_work_but_no_set() -> None:
    assert elapsed_s([], 4, 1.0) == 0.0
    assert elapsed_s([10.0] * 8, 1, 1.0) == START_S + 80.0
    assert elapsed_s([10.0] * 8, 4, 1.0) == START_S + 20.0
    assert elapsed_s([10.0] * 8, 100, 1.0) == START_S + 10.0
    assert elapsed_s([30.0, 1.0, 1.0], 2, 1.0) == START_S + 30.0
    assert elapsed_s([10.0] * 8, 4, 2.0) == 2.0 * (START_S + 20.0)


def test_designs_of_more_mirrors_take_longer() -> None:
    assert design_seconds(DesignSpec(rows=5, cols=5)) > design_seconds(DesignSpec(rows=1, cols=2)) > 0.0


def test_the_speed_of_this_machine_is_measured() -> None:
    assert 0.05 < slowness() < 50.0
