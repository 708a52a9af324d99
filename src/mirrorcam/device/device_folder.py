"""The folder of a device: every part of a layout, its files, documents and checks."""

from __future__ import annotations

from pathlib import Path

from mirrorcam.cad.plan.hardware import HARDWARE, Hardware
from mirrorcam.core.disk.output_folder import output_folder
from mirrorcam.core.processes.worker_pool import cores
from mirrorcam.core.progress import Progress, no_progress
from mirrorcam.core.values import Metric
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
    *(f"parts/.{part}.json" for part in PARTS),
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

    Figures with a limit are the checks. What an earlier call has written there and still holds is taken over, and its
    other files go. `workers` are processes that share the work, one for each core without a number. It needs the extra
    `cad`, and for `elastic`, finite elements of the whole, `fe`. Raises InputError, without `force`, where a file would
    be replaced that no such call wrote, or that was changed since.
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
                previous=folder,
                workers=workers or cores(),
                progress=progress,
                elastic=elastic,
            )
