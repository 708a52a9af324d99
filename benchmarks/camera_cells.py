"""Devices of cameras on adapters, all files built and checked, each written down as a line of JSON when it is done.

For each camera a layout of 2 x 2 mirrors is designed once and kept (for `board_38`, whose lens is any, the C920's). A
run that was cut off goes on where it stopped: a cell whose line is whole in the file is not built again.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from pydantic import Field

from mirrorcam.cad.build import build_parts
from mirrorcam.cad.plan.back_table import BACKS, back_of
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.core.disk.files import model_of, read_bytes, write_text
from mirrorcam.core.processes.worker_pool import Died, run_local
from mirrorcam.core.values import InputError, Metric, Value
from mirrorcam.optics.design.optimise import design
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.camera_library import camera_names, read_profile
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout

NOT_IN_DEVICE = ("fit_coupon", "device.")
"""Keys begin so of plastic and printing times that do not count as a part of the device: its sums count all again."""
KERNEL = ("mirrorcam.cad.device_files", __name__)
"""What takes seconds to load."""
ADAPTERS = tuple(BACKS)
CAMERAS = camera_names()
Key = tuple[str, str]


class Cell(Value):
    """What came of the device of one camera on one adapter.

    Attributes
    ----------
    camera, adapter : str
        Name of the camera in the library, kind of the back.
    seconds : float
        How long building and checking took, in one process.
    error : str
        Why there is no device, in one line; "" of one that was built.
    mass_g : float or None
        Mass of the device, plastic taken as solid.
    print_g, print_minutes : float or None
        Plastic and time to print all parts but the coupon, where a slicer is installed.
    passed : tuple of str
        Names of the checks that passed, `part.check`.
    failed : dict of str to Metric
        Checks that did not pass.
    clip : dict of str to Metric
        All checks and figures of the camera's clip.
    """

    camera: str
    adapter: str
    seconds: float = 0.0
    error: str = ""
    mass_g: float | None = None
    print_g: float | None = None
    print_minutes: float | None = None
    passed: tuple[str, ...] = ()
    failed: dict[str, Metric] = Field(default_factory=dict)
    clip: dict[str, Metric] = Field(default_factory=dict)

    @property
    def key(self) -> Key:
        """Camera and adapter."""
        return self.camera, self.adapter

    @property
    def whole(self) -> bool:
        """Whether the device was built and passed every check."""
        return not self.error and not self.failed

    @property
    def line(self) -> str:
        """The cell as a line of JSON."""
        return self.model_dump_json(exclude_none=True) + "\n"


def spec_of(camera: str) -> DesignSpec:
    """What the layout of a camera of the library is designed for."""
    profile = read_profile(camera)
    return DesignSpec(camera=profile.camera if profile.optics else Camera.c920(), rows=2, cols=2)


def layout_for(camera: str, designs: Path) -> Layout:
    """The layout of a camera; designed unless the folder has it for the same specification, and kept there."""
    path, spec = designs / f"{camera}.json", spec_of(camera)
    if path.exists():
        kept = Layout.load(path)
        # The fold of the specification is the one that was found.
        if kept.spec is not None and kept.spec.replaced(fold_deg=spec.fold_deg) == spec:
            return kept
    layout = design(spec)
    layout.save(path)
    return layout


def cell_of(camera: str, adapter: str, checks: Mapping[str, Metric], seconds: float) -> Cell:
    """The cell of a device's checks and figures."""

    def total(name: str) -> float | None:
        each = [
            metric.value
            for key, metric in checks.items()
            if key.endswith(f".{name}") and not key.startswith(NOT_IN_DEVICE)
        ]
        return round(sum(each), 1) if each else None

    return Cell(
        camera=camera,
        adapter=adapter,
        seconds=round(seconds, 1),
        mass_g=round(checks["device.mass_g"].value, 1),
        print_g=total("print_g"),
        print_minutes=total("print_minutes"),
        passed=tuple(name for name, metric in checks.items() if metric.limit is not None and metric.passed),
        failed={name: metric for name, metric in checks.items() if not metric.passed},
        clip={name: metric for name, metric in checks.items() if name.startswith("camera_clip.")},
    )


def built(camera: str, adapter: str, designs: Path, devices: Path) -> Cell:
    """Build and check a device; whatever stops it is the cell's error.

    `devices` keeps the parts of each camera: those that another adapter leaves as they are come from there.
    """
    start = time.perf_counter()
    try:
        hardware = HARDWARE.replaced(camera=read_profile(camera).body, back=back_of(adapter))
        with TemporaryDirectory(dir=devices) as folder:
            layout = layout_for(camera, designs)
            checks = build_parts(layout, Path(folder) / "device", hardware, results=devices / camera)
    except Exception as error:  # of any kind: it is written down, and the other cells go on
        text = str(error) if isinstance(error, InputError) else f"{type(error).__name__}: {error}"
        seconds = round(time.perf_counter() - start, 1)
        return Cell(camera=camera, adapter=adapter, seconds=seconds, error=" ".join(text.split()) or "no reason given")
    return cell_of(camera, adapter, checks, time.perf_counter() - start)


def read_cells(path: Path) -> dict[Key, Cell]:
    """Cells of a file by camera and adapter, later lines in place of earlier ones.

    A last line without its end is that of a run that was cut off, and is left out; InputError for any other that is no
    cell.
    """
    if not path.exists():
        return {}
    lines = read_bytes(path).split(b"\n")[:-1]
    cells = [model_of(Cell, path.with_name(f"{path.name}:{number}"), line) for number, line in enumerate(lines, 1)]
    return {cell.key: cell for cell in cells}


def fill(
    path: Path,
    cameras: Sequence[str],
    adapters: Sequence[str],
    designs: Path,
    processes: int,
    *,
    again: bool = False,
    done: Callable[[Cell], None] = lambda cell: None,
) -> dict[Key, Cell]:
    """Build the cells that a file lacks, in parallel processes, and add a line for each as it is done.

    Parameters
    ----------
    path : Path
        File of lines of JSON, new or of a run that was cut off.
    cameras, adapters : sequence of str
        Names in the library, kinds of backs; devices of one adapter after the other.
    designs : Path
        Folder that keeps the layouts, one for each camera.
    processes : int
        Number of devices that are built at once, each in one process.
    again : bool
        Also build those again that did not pass.
    done : callable
        Called with each cell as it is done.

    Returns
    -------
    dict
        All cells of the file.
    """
    cells = read_cells(path)
    write_text(path, "".join(cell.line for cell in cells.values()))
    keys = [(camera, adapter) for adapter in adapters for camera in cameras]
    missing = [key for key in keys if key not in cells or (again and not cells[key].whole)]
    wanted = [camera for camera in cameras if any(key[0] == camera for key in missing)]
    # A camera that no layout is found for says so in each of its cells.
    with closing(run_local(wanted, processes, partial(_designed, designs=designs), preload=KERNEL)) as answers:
        for _ in answers:
            pass
    with (
        TemporaryDirectory() as devices,
        path.open("a", encoding="utf-8") as lines,
        closing(
            run_local(missing, processes, partial(_built, designs=designs, devices=Path(devices)), preload=KERNEL)
        ) as answers,
    ):
        for number, answer in answers:
            camera, adapter = missing[number]
            cell = Cell(camera=camera, adapter=adapter, error=answer.reason) if isinstance(answer, Died) else answer
            lines.write(cell.line)
            lines.flush()
            cells[cell.key] = cell
            done(cell)
    return cells


def _designed(camera: str, *, designs: Path) -> str:
    """Have the folder hold the layout of a camera; returns why there is none, or ""."""
    try:
        layout_for(camera, designs)
    except InputError as error:
        return str(error)
    return ""


def _built(key: Key, *, designs: Path, devices: Path) -> Cell:
    return built(*key, designs, devices)
