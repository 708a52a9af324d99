"""A folder with `light_field.npy` for plenpy, whose `LightField(numpy.load(...))` is [u, v, s, t, channel] from 0 to 1.

Its u and v go down and right among the views: our order under other names. Its disparity is positive for nearer points,
and, in its plane fits as in LFFiltShiftSum, px per view times (N - 1) / N.
"""

from __future__ import annotations

from mirrorcam.optics.light_field.io.light_field_format import Format, single, without_depth
from mirrorcam.optics.light_field.io.view_arrays import read_arrays, write_arrays

ARRAY = "light_field.npy"
LARGEST = 1.0

FORMAT = Format(
    name="plenpy",
    ending="_plenpy",
    detect=lambda path: (path / ARRAY).exists(),
    read=single(lambda path, assumed: read_arrays(path / ARRAY, LARGEST, assumed)),
    write=without_depth(lambda path, light_field: write_arrays(path / ARRAY, light_field, LARGEST)),
    needs_grid=True,
)
