"""Areas of carriers: within their mirrors, with three screws each, beside the mount's screws."""

from __future__ import annotations

from itertools import combinations

import pytest
from shapely import Point, Polygon

from mirrorcam.cad.holder.adjuster import boss_mm
from mirrorcam.cad.holder.back import mount_axes
from mirrorcam.cad.holder.carrier_areas import plan_areas
from mirrorcam.core.values import InputError
from mirrorcam.optics.geometry.layout import Layout
from tests.cad.holder.screwed import with_screws
from tests.cad.parabolas import parabola


def test_a_carrier_ends_within_its_mirror_and_bears_three_screws(default_layout: Layout) -> None:
    axes, hardware = mount_axes(default_layout), with_screws()
    _, areas = plan_areas(default_layout, axes, [Polygon()], hardware)
    for mirror, area in zip(default_layout.mirrors, areas, strict=True):
        outline = Polygon(mirror.outline_in_rig_mm @ axes[:2].T)
        carrier = Polygon(area.corners)
        assert outline.contains(carrier)
        assert Polygon(area.screws).contains(carrier.centroid)
        for screw in area.screws:
            assert carrier.buffer(1e-6).contains(Point(screw).buffer(boss_mm(hardware) - 1e-3))
    for first, second in combinations(areas, 2):
        assert Polygon(first.corners).distance(Polygon(second.corners)) > 1.0


def test_the_first_place_of_the_mount_that_leaves_space_is_taken(default_layout: Layout) -> None:
    axes, hardware = mount_axes(default_layout), with_screws()
    everywhere = Point(0.0, 0.0).buffer(1e3)
    place, areas = plan_areas(default_layout, axes, [everywhere, Polygon()], hardware)
    assert place == 1
    beside = Point(areas[0].screws[0]).buffer(1.0)
    _, moved = plan_areas(default_layout, axes, [beside], hardware)
    assert not any(beside.contains(Point(screw)) for screw in moved[0].screws)
    with pytest.raises(InputError, match=r"no space .* more beside the mount's own screws, or holder\.mirrors"):
        plan_areas(default_layout, axes, [everywhere], hardware)


@pytest.mark.parametrize("kind", ["insert", "nut"])
def test_a_mirror_too_small_for_three_screws_is_refused_with_what_would_fit(kind: str) -> None:
    layout = parabola(2, 2, scale_mm=40.0)
    with pytest.raises(
        InputError, match=r"mirror 1-0 .* expected mirrors 1\.\d\d times as large, or .*glue"
    ) as refused:
        plan_areas(layout, mount_axes(layout), [Polygon()], with_screws(kind))
    assert len(str(refused.value)) <= 300
    larger = parabola(2, 2, scale_mm=60.0)
    assert len(plan_areas(larger, mount_axes(larger), [Polygon()], with_screws(kind))[1]) == 4
