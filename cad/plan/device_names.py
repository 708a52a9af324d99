"""Names of a device's printed parts, pictures and files."""

from __future__ import annotations

from mirrorcam.cad.plan.hardware import Hardware

HOLDER, MOUNT, CLIP, COUPON, COVER = "mirror_holder", "mount", "camera_clip", "fit_coupon", "dust_cover"
"""Names of printed parts; the table of an adapter names its own parts."""
CAMERA = "camera"
"""Name of the camera among the pieces of a device."""
UNMOUNTED = (COUPON, COVER)
"""Printed parts that are not mounted while the device is in use."""
CARRIER = "carrier_"
"""Prefix of the names of carriers, which hold mirrors on screws."""
PICTURES = (
    *("assembled", "exploded", "light", "behind", "print"),
    *("inserts", "mirrors", "holder", "camera", "clip", "adapter"),
)
"""Names of the pictures of a device's model, in the order of the device's page."""
THREAD, SEAT, FILM, TIE = CLOSE_UPS = ("thread", "seat", "film", "tie")
"""Names of the pictures of single actions, of which a device may lack some."""


def carrier_name(mirror: str) -> str:
    """Name of the carrier of a mirror, from the mirror's name."""
    return f"{CARRIER}{mirror}"


def files_of(hardware: Hardware, *, elastic: bool = False) -> tuple[str, ...]:
    """Patterns (`Path.glob`) of all files that a device of this hardware may have, relative to its folder.

    A part larger than the printer's bed is written as numbered pieces, and the mirrors of several stock sheets as
    numbered sheets. `elastic` adds the files of the finite elements.
    """
    cover = (COVER,) if hardware.holder.dust_cover else ()
    carriers = (f"{CARRIER}[0-9]*",) if hardware.holder.mirrors == "screws" else ()
    uncut = (HOLDER, MOUNT, CLIP, *hardware.back.parts, COUPON, *cover, *carriers)
    source = (f"source/{hardware.back.source.name}",) if hardware.back.source else ()
    parts = (*uncut, *(f"{part}_[0-9]*" for part in uncut))
    robot = (
        *("robot/mirrorcam.xacro", "robot/mirrorcam.urdf"),
        *(f"robot/meshes/{name}.stl" for name in ("mirrors", "camera", "fasteners", "camera_hull")),
        *(f"robot/meshes/{part}_hull.stl" for part in parts),
    )
    return (
        *("index.html", "guide.md", "checks.json", "bom.md", "bom.csv", "bom.json", "assembly.step", "assembly.glb"),
        *(f"parts/{part}.{extension}" for part in parts for extension in ("step", "stl", "3mf")),
        *(f"drawings/{part}.{extension}" for part in (*parts, "assembly", "side_view") for extension in ("svg", "pdf")),
        *(f"mirrors/mirrors{sheet}.{extension}" for sheet in ("", "_[0-9]*") for extension in ("dxf", "svg")),
        *("mirrors/cutting.md", "mirrors/scale_bar.dxf", "mirrors/scale_bar.svg"),
        *("plates/plate_[0-9]*.3mf", "plates/mirrorcam.ini", "plates/mirrorcam_orca.json"),
        *("NOTICE.txt", "source/layout.json", "source/hardware.toml", *source),
        *(f"pictures/{name}.png" for name in (*PICTURES, *CLOSE_UPS, "live_view", "live_overlay")),
        *(robot if hardware.back.on_arm else ()),
        *(("elasticity.md", "elasticity.json", "robot/gravity.json") if elastic else ()),
    )
