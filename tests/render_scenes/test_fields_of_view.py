"""Fields that mirrors show of a plane: against the projection of the layout, and where they do not overlap."""

from __future__ import annotations

import numpy as np

from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.fields_of_view import common_bounds, fields


def test_every_mirror_shows_the_common_field(default_layout: Layout) -> None:
    (low_x, low_y), (high_x, high_y) = common_bounds(default_layout, 400.0)
    assert high_x - low_x > 100.0
    assert high_y - low_y > 60.0
    middle = [(low_x + high_x) / 2, (low_y + high_y) / 2, 400.0]
    for point_in_view, shown in ((middle, True), ([high_x + 200.0, middle[1], 400.0], False)):
        point = default_layout.view_from_rig.T @ np.array(point_in_view)
        px = np.array([default_layout.project(point, index) for index in range(9)])
        assert all((0 < x < 1919 and 0 < y < 1079) for x, y in px) == shown
    for index, field in enumerate(fields(default_layout, 400.0)):
        corners = np.array(field.exterior.coords[:-1])
        in_rig = np.column_stack([corners, np.full(len(corners), 400.0)]) @ default_layout.view_from_rig
        mirror = default_layout.mirrors[index]
        seen = mirror.reflect(in_rig)
        np.testing.assert_allclose(seen[:, :2] / seen[:, 2:], mirror.outline_normalized, atol=1e-9)


def test_without_a_common_field_the_median_one_is_taken(default_layout: Layout) -> None:
    # At the pupil's depth but far to the sides, mirrors that look apart share nothing.
    apart = default_layout.replaced(
        mirrors=tuple(
            mirror.moved(np.eye(3), np.array([400.0 * (index - 4), 0.0, 0.0]))
            for index, mirror in enumerate(default_layout.mirrors)
        ),
        kind="as-built",
        spec=None,
    )
    shown = fields(apart, 400.0)
    assert shown[0].intersection(shown[8]).is_empty
    np.testing.assert_allclose(
        common_bounds(apart, 400.0).ravel(), np.median([field.bounds for field in shown], axis=0)
    )
