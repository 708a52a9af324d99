"""ESLF, the format of the Stanford Lytro archives: a small picture of the aperture at every pixel of a view.

Row T v + t and column S u + s of the picture hold sample [t, s, v, u] of T x S views. The name ends in `eslf`.
"""

from __future__ import annotations

from pathlib import Path

from mirrorcam.core.images.pictures import is_picture
from mirrorcam.optics.light_field.io.light_field_format import Format, depthless_writer, single_reader
from mirrorcam.optics.light_field.io.mosaic import read_mosaic, write_mosaic


def is_eslf(path: Path) -> bool:
    """Return whether a path is named like an ESLF picture."""
    return is_picture(path) and path.stem.lower().endswith("eslf")


FORMAT = Format(
    name="eslf",
    ending="_eslf.png",
    detect=is_eslf,
    read=single_reader(lambda path, assumed: read_mosaic(path, "eslf", assumed)),
    write=depthless_writer(lambda path, light_field: write_mosaic(path, light_field, "eslf")),
    needs_grid=True,
)
