"""A folder with `light_field.npy` for plenpy, whose `LightField(numpy.load(...))` is [u, v, s, t, channel] from 0 to 1.

Its u and v count rows and columns of views: our order under other names. Its disparity is positive for nearer points,
and, in its plane fits as in LFFiltShiftSum, px per view times (N - 1) / N.
"""

from __future__ import annotations

from mirrorcam.optics.light_field.io.light_field_format import Format, depthless_writer, single_reader
from mirrorcam.optics.light_field.io.view_arrays import read_arrays, write_arrays

ARRAY = "light_field.npy"
FULL_SCALE = 1.0

FORMAT = Format(
    name="plenpy",
    ending="_plenpy",
    detect=lambda path: (path / ARRAY).exists(),
    read=single_reader(lambda path, assumed: read_arrays(path / ARRAY, FULL_SCALE, assumed)),
    write=depthless_writer(lambda path, light_field: write_arrays(path / ARRAY, light_field, FULL_SCALE)),
    needs_grid=True,
)
