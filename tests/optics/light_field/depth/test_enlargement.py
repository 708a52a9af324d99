"""Enlargement of a map, guided by the picture: surfaces are interpolated, and depth edges end up at picture edges."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.light_field.depth.enlargement import enlarged_by_picture


def test_a_plane_is_interpolated() -> None:
    v, u = np.mgrid[:10, :12].astype(np.float32)
    grey = np.full((20, 24, 3), 90.0, np.float32)
    found = enlarged_by_picture(0.3 * u - 0.2 * v, grey[::2, ::2], grey, 1.0)
    row, column = (np.mgrid[:20, :24].astype(np.float32) - 0.5) / 2.0
    np.testing.assert_allclose(found[1:-1, 1:-1], (0.3 * column - 0.2 * row)[1:-1, 1:-1], atol=1e-5)


@pytest.mark.parametrize("edge", [11, 12, 13])
@pytest.mark.parametrize("odd", [0, 1])
def test_a_depth_edge_lies_where_the_picture_has_its_edge(edge: int, odd: int) -> None:
    full = np.full((20 + odd, 24 + odd, 3), 60.0, np.float32)
    full[:, edge:] = 180.0
    half = full[:20, :24].reshape(10, 2, 12, 2, 3).mean(axis=(1, 3))
    planes = np.where(half[..., 0] < 121, np.float32(2.0), np.float32(9.0))
    found = enlarged_by_picture(planes, half, full, 1.0)
    assert (found == np.where(full[..., 0] < 100, 2.0, 9.0)).all()
