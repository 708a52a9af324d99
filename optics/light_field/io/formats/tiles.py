"""Views side by side in one picture, without gaps: row V t + v and column U s + u, for views of U x V px."""

from __future__ import annotations

from mirrorcam.core.images.pictures import is_picture
from mirrorcam.optics.light_field.io.formats.eslf import is_eslf
from mirrorcam.optics.light_field.io.light_field_format import Format, depthless_writer, single_reader
from mirrorcam.optics.light_field.io.mosaic import read_mosaic, write_mosaic

FORMAT = Format(
    name="tiles",
    ending="_tiles.png",
    detect=lambda path: is_picture(path) and not is_eslf(path),
    read=single_reader(lambda path, assumed: read_mosaic(path, "tiles", assumed)),
    write=depthless_writer(lambda path, light_field: write_mosaic(path, light_field, "tiles")),
    needs_grid=True,
)
