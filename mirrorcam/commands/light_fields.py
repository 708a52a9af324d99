"""What commands that read light fields share: which ones, and how they are opened."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from pydantic import Field

from mirrorcam.optics.base.values import InputError, Value

if TYPE_CHECKING:
    from mirrorcam.optics.light_field.light_field import LightField


class LightFieldsOptions(Value):
    """Light fields of any kind that `opened` reads."""

    light_fields: Annotated[
        tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="LIGHTFIELD...", help_behavior_hint="")
    ] = Field(
        min_length=1,
        description=(
            "what mirrorcam decode wrote (.npz or .zarr), a folder of the 4D Light Field Benchmark, or, with --layout, "
            "PNG or JPEG frames of the camera"
        ),
    )
    layout: Annotated[Path | None, tyro.conf.arg(metavar="PATH", help_behavior_hint="")] = Field(
        default=None, description="layout.json of frames, calibrated where there is one"
    )


def distinct_names(paths: Sequence[Path], what: str) -> list[str]:
    """Names of the light fields, by which their results are called; InputError for two alike."""
    names = [path.stem for path in paths]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise InputError(f"two light fields are called {twice!r}, expected different names: each names its {what}")
    return names


def opened(path: Path, layout: Path | None) -> Iterator[tuple[str, LightField, tuple[float, float] | None]]:
    """The light fields of a file or folder, one after the other, each with a name and the depths it says it has."""
    from mirrorcam.optics.base.files import is_picture, read_image
    from mirrorcam.optics.light_field.io.formats.hci import PARAMETERS, read_hci
    from mirrorcam.optics.light_field.io.npz import load_npz

    if is_picture(path):
        if layout is None:
            raise InputError(f"{path}: a frame, expected --layout to decode it with, or a light field")
        from mirrorcam.optics.geometry.layout import Layout
        from mirrorcam.optics.light_field.decoder import Decoder

        yield path.stem, Decoder(Layout.load(layout)).decode(read_image(path)), None
    elif (path / PARAMETERS).exists():
        scene = read_hci(path)
        yield path.name, scene.light_field, scene.depth_range_mm
    elif path.is_dir():
        from mirrorcam.optics.light_field.io.zarr_store import StoredLightFields

        stored = StoredLightFields(path)
        for frame in range(len(stored)):
            yield f"{path.stem}_{frame:06d}", stored[frame], None
    else:
        yield path.stem, load_npz(path), None
