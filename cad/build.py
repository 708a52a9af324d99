"""The builder of a layout's device: the files that it writes, and what it refuses before it loads the CAD kernel."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from mirrorcam.cad.plan.hardware import HARDWARE, Hardware
from mirrorcam.cad.plan.part_plan import CARRIER, CLIP, COUPON, COVER, HOLDER, MOUNT
from mirrorcam.core.arguments import AnyPath, check_count, check_type, path_of
from mirrorcam.core.bounds import WORKERS
from mirrorcam.core.processes.worker_process import begin_loading
from mirrorcam.core.progress import Progress, no_progress
from mirrorcam.core.values import InputError, Metric
from mirrorcam.optics.geometry.layout import Layout

EXTRA = ("build123d", "OCP", "trimesh", "manifold3d", "ezdxf", "lib3mf", "jinja2", "markdown_it")
# What takes seconds to load, with the CAD kernel.
KERNEL = ("mirrorcam.cad.device_files",)
PICTURES = (
    *("assembled", "exploded", "light", "behind", "print"),
    *("inserts", "mirrors", "holder", "camera", "clip", "adapter"),
)
"""Names of the pictures of a device's model, in the order in which the page shows them."""


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
        *(f"parts/.{part}.json" for part in parts),
        *(f"drawings/{part}.{ending}" for part in (*parts, "assembly") for ending in ("svg", "pdf")),
        *(f"mirrors/mirrors{sheet}.{ending}" for sheet in ("", "_[0-9]*") for ending in ("dxf", "svg")),
        *("plates/plate_[0-9]*.3mf", "plates/mirrorcam.ini", "plates/mirrorcam_orca.json"),
        *("NOTICE.txt", "source/layout.json", "source/hardware.toml"),
        *(f"pictures/{name}.png" for name in (*PICTURES, "live_view", "live_overlay")),
        *(robot if hardware.back.on_arm else ()),
        *(("elasticity.md", "elasticity.json", "robot/gravity.json") if elastic else ()),
    )


def build_parts(
    layout: Layout,
    out: AnyPath,
    hardware: Hardware = HARDWARE,
    *,
    previous: AnyPath | None = None,
    workers: int = 1,
    progress: Progress = no_progress,
    elastic: bool = False,
) -> dict[str, Metric]:
    """Write all files of a layout's device (`files_of`): parts, mirrors to cut, drawings, guide, page and checks.

    Parameters
    ----------
    layout
        Layout whose device is built, usually a nominal one.
    out
        New or empty folder for the files; `index.html` there leads to all of them.
    hardware
        Dimensions that parts are drawn from: camera body, screws, printer, cutter, clearances in mm.
    previous
        Folder written earlier; parts there that were made of the same numbers are copied instead of built again.
    workers
        Number of processes that share the work.
    progress
        Called with the numbers of steps done and of all.
    elastic
        Whether finite elements predict how gravity, warmth and creep move the mirrors, which takes a minute or two; it
        needs the extra `fe`.

    Returns
    -------
    dict of str to Metric
        All figures by name, as in `checks.json`. Those with a limit are the checks; one that fails is past its limit.

    Raises
    ------
    InputError
        If the device cannot be made (the message names the measure), the extra `cad` is not installed, or `out` cannot
        be written; files in `out` are then of no use.
    """
    check_type("layout", layout, Layout)
    check_type("hardware", hardware, Hardware)
    out = path_of("out", out)
    check_count("workers", workers, WORKERS)
    earlier = None if previous is None else path_of("previous", previous)
    if workers > 1:
        begin_loading(KERNEL)
    with _extra_installed():
        from mirrorcam.cad.assembly.device_plan import plan_device
    if elastic and hardware.holder.mirrors == "screws":
        raise InputError('finite elements hold mirrors by glue, expected holder.mirrors = "glue" or no --elastic')
    if elastic:
        from mirrorcam.cad.checks.elasticity.elasticity_report import require_solvable

        require_solvable(hardware)
    device = plan_device(layout, hardware)
    with _extra_installed():
        from mirrorcam.cad.device_files import write_files
        from mirrorcam.cad.holder.holder_solid import check_gaps
    check_gaps(layout, hardware)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        reason = "is a file" if out.exists() else f"cannot be written: {error.strerror}"
        raise InputError(f"{out}: {reason}, expected a new or empty folder") from None
    return write_files(device, out, earlier, workers, progress, elastic=elastic)


@contextmanager
def _extra_installed() -> Iterator[None]:
    """Raise InputError, with the command that installs the extra, where an import in the block lacks part of it."""
    try:
        yield
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] not in EXTRA:
            raise
        install = 'pip install "mirrorcam[cad]"'
        raise InputError(f"{error.name} is not installed, needed to build parts: {install}") from None
