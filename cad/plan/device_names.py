"""Names of a device's printed parts, pictures and files."""

from __future__ import annotations

from mirrorcam.cad.plan.hardware import Hardware

HOLDER, MOUNT, CLIP, COUPON, COVER = "mirror_holder", "mount", "camera_clip", "fit_coupon", "dust_cover"
"""The printed parts of every device, if it has them; the table of a back states the names of its parts."""
APART = (COUPON, COVER)
"""Printed parts that are no pieces of the device in use."""
CARRIER = "carrier_"
"""Start of the names of the carriers of mirrors on screws."""
PICTURES = (
    *("assembled", "exploded", "light", "behind", "print"),
    *("inserts", "mirrors", "holder", "camera", "clip", "adapter"),
)
"""Names of the pictures of a device's model, in the order in which the page shows them."""


def carrier_name(mirror: str) -> str:
    """Return the name of the part that carries a mirror, from the mirror's name."""
    return f"{CARRIER}{mirror}"


def files_of(hardware: Hardware, *, elastic: bool = False) -> tuple[str, ...]:
    """Return the paths in its folder of all files that a device of this hardware may have, as patterns of `Path.glob`.

    A part that is larger than the printer's bed is written in numbered pieces, the mirrors of several stock sheets in
    numbered sheets. With `elastic`, the files of finite elements come in addition.
    """
    cover = (COVER,) if hardware.holder.dust_cover else ()
    carriers = (f"{CARRIER}[0-9]*",) if hardware.holder.mirrors == "screws" else ()
    whole = (HOLDER, MOUNT, CLIP, *hardware.back.parts, COUPON, *cover, *carriers)
    parts = (*whole, *(f"{part}_[0-9]*" for part in whole))
    robot = (
        *("robot/mirrorcam.xacro", "robot/mirrorcam.urdf"),
        *(f"robot/meshes/{name}.stl" for name in ("mirrors", "camera", "fasteners", "camera_hull")),
        *(f"robot/meshes/{part}_hull.stl" for part in parts),
    )
    return (
        *("index.html", "guide.md", "checks.json", "bom.md", "bom.csv", "bom.json", "assembly.step", "assembly.glb"),
        *(f"parts/{part}.{ending}" for part in parts for ending in ("step", "stl", "3mf")),
        *(f"drawings/{part}.{ending}" for part in (*parts, "assembly") for ending in ("svg", "pdf")),
        *(f"mirrors/mirrors{sheet}.{ending}" for sheet in ("", "_[0-9]*") for ending in ("dxf", "svg")),
        *("plates/plate_[0-9]*.3mf", "plates/mirrorcam.ini", "plates/mirrorcam_orca.json"),
        *("NOTICE.txt", "source/layout.json", "source/hardware.toml"),
        *(f"pictures/{name}.png" for name in (*PICTURES, "live_view", "live_overlay")),
        *(robot if hardware.back.on_arm else ()),
        *(("elasticity.md", "elasticity.json", "robot/gravity.json") if elastic else ()),
    )
