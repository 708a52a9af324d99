"""The folder of a device: every part of a layout, its files, documents and checks."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from mirrorcam.cad.plan.back_table import back_of
from mirrorcam.cad.plan.hardware import HARDWARE, Hardware
from mirrorcam.core.disk.files import read_model
from mirrorcam.core.disk.output_folder import output_folder, results_folder
from mirrorcam.core.processes.worker_pool import cores
from mirrorcam.core.progress import Progress, no_progress
from mirrorcam.core.values import Metric
from mirrorcam.optics.geometry.camera_library import profile_of, read_body
from mirrorcam.optics.geometry.layout import Layout

BACKS = (
    *("adapter_desk", "adapter_tripod", "adapter_arca", "adapter_flange", "adapter_centring", "adapter_spacer"),
    *("adapter_saddle", "adapter_cap", "adapter_profile", "adapter_vesa", "adapter_hook", "adapter_jaw"),
)
WHOLE = ("mirror_holder", "mount", "camera_clip", *BACKS, "fit_coupon", "dust_cover", "carrier_[0-9]*")
PARTS = (*WHOLE, *(f"{part}_[0-9]*" for part in WHOLE))
"""Names of the parts, as patterns: some are printed in pieces."""
PICTURES = (
    *("assembled", "exploded", "light", "behind", "print", "inserts"),
    *("mirrors", "holder", "camera", "clip", "adapter", "live_view", "live_overlay"),
)
"""Names of the pictures of a device."""
FILES = (
    *("index.html", "guide.md", "checks.json", "bom.md", "bom.csv", "bom.json", "assembly.step", "assembly.glb"),
    *(f"parts/{part}.{ending}" for part in PARTS for ending in ("step", "stl", "3mf")),
    *(f"drawings/{part}.{ending}" for part in (*PARTS, "assembly") for ending in ("svg", "pdf")),
    *(f"mirrors/mirrors{sheet}.{ending}" for sheet in ("", "_[0-9]*") for ending in ("dxf", "svg")),
    *("plates/plate_[0-9]*.3mf", "plates/mirrorcam.ini", "plates/mirrorcam_orca.json"),
    *("NOTICE.txt", "source/layout.json", "source/hardware.toml"),
    *("robot/mirrorcam.xacro", "robot/mirrorcam.urdf", "robot/gravity.json", "elasticity.md", "elasticity.json"),
    *(f"robot/meshes/{name}.stl" for name in ("mirrors", "camera", "fasteners", "camera_hull")),
    *(f"robot/meshes/{part}_hull.stl" for part in PARTS),
    *(f"pictures/{name}.png" for name in PICTURES),
)
"""Files of a device, as patterns: a file of another origin at one of these places stops the command before its work."""


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


def write_device(
    layout: Layout,
    folder: Path,
    hardware: Hardware = HARDWARE,
    *,
    workers: int | None = None,
    force: bool = False,
    elastic: bool = False,
    progress: Progress = no_progress,
) -> dict[str, Metric]:
    """Build and check every part of a layout's device in a folder; returns all figures by name.

    Figures with a limit are the checks. Parts that an earlier call has made are not built again, and files that it
    wrote and this one does not are deleted. `workers` are processes that share the work, one for each core without a
    number. It needs the extra `cad`, and for `elastic`, finite elements of the whole, `fe`. Raises InputError, without
    `force`, where a file would be replaced that no such call wrote, or that was changed since.
    """
    from mirrorcam.cad.build import build_parts

    with output_folder(folder, "cad", force=force) as output:
        output.refuse_changed()
        output.refuse_others(*FILES)
        with output.staged(result="checks.json") as staged:
            return build_parts(
                layout,
                staged,
                hardware,
                results=results_folder(folder),
                workers=workers or cores(),
                progress=progress,
                elastic=elastic,
            )
