"""The hardware that a device is built from, as a file states it, and the folder that it is built in."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

from mirrorcam.cad.plan.back_table import back_of
from mirrorcam.cad.plan.device_names import files_of
from mirrorcam.cad.plan.hardware import HARDWARE, Hardware
from mirrorcam.core.disk.files import read_model
from mirrorcam.core.disk.output_folder import output_folder
from mirrorcam.optics.geometry.camera_library import profile_of, read_body
from mirrorcam.optics.geometry.layout import Layout


def read_hardware(
    table: Path | None = None,
    *,
    camera: str | None = None,
    fasteners: Literal["insert", "nut"] | None = None,
    adapter: str | None = None,
    mirrors: Literal["glue", "screws"] | None = None,
    layout: Layout | None = None,
) -> Hardware:
    """The table of dimensions of a TOML file, else the default one, with another camera, fasteners, back or seats.

    `camera` is the name of a camera of the library or a TOML file. Where neither it nor the table states one, the body
    is that of the camera of the library that the layout is made for, else that of the C920. `adapter` is the kind of a
    back, one of `BACKS` of `cad.plan.back_table`; of the same kind, the dimensions of the table's own are kept.
    `mirrors` says how these sit. Raises InputError for a file that is not valid.
    """
    hardware = HARDWARE if table is None else read_model(Hardware, table)
    if camera:
        hardware = hardware.replaced(camera=read_body(camera))
    elif layout is not None and "camera" not in hardware.model_fields_set and (known := profile_of(layout.camera)):
        hardware = hardware.replaced(camera=known.body)
    if fasteners:
        hardware = hardware.replaced(screw=hardware.screw.replaced(kind=fasteners))
    if mirrors:
        hardware = hardware.replaced(holder=hardware.holder.replaced(mirrors=mirrors))
    if adapter and adapter != hardware.back.kind:
        hardware = hardware.replaced(back=back_of(adapter))
    return hardware


@contextmanager
def device_folder(folder: Path, hardware: Hardware, *, elastic: bool, force: bool) -> Iterator[Path]:
    """Yield an empty folder for `build_parts`, whose files replace those of an earlier call when the block ends.

    They are also put in their places where the block ends with an error after the checks are written. Raises
    InputError, before the block, without `force` where a file would be replaced that no such call wrote, or that was
    changed since.
    """
    with output_folder(folder, "cad", force=force) as output:
        output.refuse_changed()
        output.refuse_others(*files_of(hardware, elastic=elastic))
        with output.staged(result="checks.json") as staged:
            yield staged
