"""Build all files of a layout's device, after checks that need no file."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from mirrorcam.cad.plan.hardware import HARDWARE, Hardware
from mirrorcam.core.arguments import AnyPath, check_callable, check_count, check_type, path_of
from mirrorcam.core.bounds import WORKERS
from mirrorcam.core.disk.results import Results
from mirrorcam.core.errors import InputError
from mirrorcam.core.processes.worker_process import begin_loading
from mirrorcam.core.progress import Progress, no_progress
from mirrorcam.core.values import Metric
from mirrorcam.optics.geometry.layout import Layout

EXTRA = ("build123d", "OCP", "trimesh", "manifold3d", "ezdxf", "lib3mf", "jinja2", "markdown_it")
# Modules that load the CAD kernel, which takes seconds.
KERNEL = ("mirrorcam.cad.device_files",)


def build_parts(
    layout: Layout,
    out: AnyPath,
    hardware: Hardware = HARDWARE,
    *,
    results: AnyPath | None = None,
    workers: int = 1,
    progress: Progress = no_progress,
    elastic: bool = False,
) -> dict[str, Metric]:
    """Write all files of a layout's device (`files_of`): parts, cut files of mirrors, drawings, guide, page and checks.

    Parameters
    ----------
    layout
        Layout whose device is built, usually a nominal one.
    out
        New or empty folder for the files; `index.html` there leads to all of them.
    hardware
        Dimensions from which parts are made, in mm: camera body, screws, printer, cutter, clearances.
    results
        Store of finished parts; a part with the same dimensions, made by the same program, is read from it.
    workers
        Number of processes that share the work.
    progress
        Called with the number of finished steps and the number of all steps.
    elastic
        Predict by finite elements how gravity, temperature and creep move the mirrors. This takes a minute or two, and
        requires the extra `fe`.

    Returns
    -------
    dict of str to Metric
        All figures by name, as in `checks.json`. A figure with a limit is a check, which fails past the limit.

    Raises
    ------
    InputError
        If the device cannot be made (the message gives the dimension), the extra `cad` is not installed, or `out`
        cannot be written. Files already in `out` are then incomplete.
    """
    check_type("layout", layout, Layout)
    check_type("hardware", hardware, Hardware)
    out = path_of("out", out)
    check_count("workers", workers, WORKERS)
    check_callable("progress", progress)
    store = None if results is None else Results(path_of("results", results))
    if workers > 1:
        begin_loading(KERNEL)
    with _extra_installed():
        from mirrorcam.cad.assembly.device_plan import plan_device
    if elastic and hardware.holder.mirrors == "screws":
        raise InputError(
            'finite elements do not model mirrors on screws, expected holder.mirrors = "tape" or "glue" or no --elastic'
        )
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
    return write_files(device, out, store, workers, progress, elastic=elastic)


@contextmanager
def _extra_installed() -> Iterator[None]:
    """Raise InputError with the install command if an import in the block needs the extra `cad`."""
    try:
        yield
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] not in EXTRA:
            raise
        install = 'pip install "mirrorcam[cad]"'
        raise InputError(f"{error.name} is not installed, but is needed to build parts: {install}") from None
