"""One light field as NumPy's .npz, with the fields of `LightField` as arrays of the same names."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

from mirrorcam.core.disk.array_files import read_npz
from mirrorcam.core.disk.files import write_npz
from mirrorcam.core.errors import InputError
from mirrorcam.optics.light_field.io.light_field_format import Format, depthless_writer, single_reader
from mirrorcam.optics.light_field.io.views_file import light_field_of_fields
from mirrorcam.optics.light_field.light_field import LightField


def save_npz(path: Path, light_field: LightField) -> None:
    """Write the fields of a light field to an .npz file, atomically; equal light fields give equal bytes."""
    write_npz(path, {field.name: getattr(light_field, field.name) for field in fields(light_field)})


def load_npz(path: Path) -> LightField:
    """Read a file written by `save_npz`; raises a one-line InputError for any other or a damaged file."""
    names = [field.name for field in fields(LightField)]
    arrays = read_npz(path, names)
    missing = [name for name in names if name not in arrays]
    if missing:
        raise InputError(f"{path}: has no {', '.join(missing)}, expected a light field of mirrorcam decode")
    return light_field_of_fields(arrays, str(path))


FORMAT = Format(
    name="npz",
    ending=".npz",
    detect=lambda path: path.suffix.lower() == ".npz" and not path.is_dir(),
    read=single_reader(lambda path, assumed: load_npz(path)),
    write=depthless_writer(save_npz),
)
