"""Light fields as files: one as NumPy's .npz, which any program with NumPy reads."""

from __future__ import annotations

import zipfile
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from mirrorcam.optics.base.files import atomic
from mirrorcam.optics.base.values import InputError
from mirrorcam.optics.light_field.light_field import LightField

# What an .npz holds of these as arrays without dimensions.
_SCALARS: dict[str, type] = {
    "focal_px": float,
    "width_px": int,
    "height_px": int,
    "reference_depth_mm": float,
    "layout_identity": str,
}


def save_npz(path: Path, light_field: LightField) -> None:
    """Write the fields of a light field to an .npz file, atomically; the same light field gives the same bytes."""
    with atomic(path) as temporary:
        np.savez_compressed(
            temporary, **{field.name: getattr(light_field, field.name) for field in fields(light_field)}
        )


def load_npz(path: Path) -> LightField:
    """Read what `save_npz` wrote; raises InputError in one line for a file that is not, or no longer, such a one."""
    names = [field.name for field in fields(LightField)]
    try:
        archive = np.load(path, allow_pickle=False)
        if not isinstance(archive, np.lib.npyio.NpzFile):
            raise InputError(f"{path}: not an .npz file, expected a light field of mirrorcam decode")
        with archive:
            missing = [name for name in names if name not in archive]
            if missing:
                raise InputError(f"{path}: has no {', '.join(missing)}, expected a light field of mirrorcam decode")
            arrays = {name: archive[name] for name in names}
    except InputError:
        raise
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
    except (zipfile.BadZipFile, EOFError, ValueError) as error:
        raise InputError(f"{path}: not an .npz file that can be read: {error}") from None
    return from_arrays(arrays, str(path))


def from_arrays(arrays: dict[str, Any], where: str) -> LightField:
    """The light field of its fields by name, or InputError in one line that begins with `where`."""
    try:
        scalars = {name: kind(np.asarray(arrays[name]).item()) for name, kind in _SCALARS.items()}
        return LightField(**(arrays | scalars))
    except (ValueError, TypeError) as error:
        raise InputError(f"{where}: not a light field: {error}") from None


def read_light_field(path: Path, frame: int = 0) -> LightField:
    """The light field of an .npz file, or that of a frame (counted from 0) of a recording in Zarr.

    Raises InputError in one line for anything else, and for a frame that the recording does not have.
    """
    if not path.is_dir():
        if frame != 0:
            raise InputError(f"{path}: has one frame, expected no frame {frame}")
        return load_npz(path)
    from mirrorcam.optics.light_field.io.zarr_store import StoredLightFields

    stored = StoredLightFields(path)
    if not 0 <= frame < len(stored):
        raise InputError(f"{path}: has {len(stored)} frames, expected no frame {frame}")
    return stored[frame]
