"""Serve the studio's page on the loopback address until Ctrl-C."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from mirrorcam.designs.design_files import read_request
from mirrorcam.designs.design_sweep import finished_designs
from mirrorcam.optics.design.spec_grid import Outcome
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.studio.designer import Designer


@dataclass(frozen=True)
class Opening:
    """Initial content of the page: a request, its layout if it was solved before, and the designs of a sweep."""

    spec: DesignSpec
    layout: Layout | None = None
    sweep: tuple[tuple[Outcome, Path], ...] = ()


def opened(path: Path | None) -> Opening:
    """Read a designed layout, a request, or the designs in the folder of a sweep.

    Raises a one-line InputError.
    """
    if path is None:
        return Opening(DesignSpec())
    if path.is_dir():
        designs = tuple(finished_designs(path))
        return Opening(designs[0][0].spec, sweep=designs)
    spec = read_request(path).spec
    layout = Layout.load(path) if "mirrors" in path.read_text(encoding="utf-8") else None
    return Opening(spec, layout if layout is not None and layout.verdict and layout.kind == "nominal" else None)


def serve(opening: Opening, *, port: int, out: Path, browser: bool, on_note: Callable[[str], None]) -> int:
    """Serve until Ctrl-C, and return 0. Raises InputError for a port in use."""
    designer = Designer()
    try:
        designer.start()
        _serve(opening, designer, port, out, browser=browser, on_note=on_note)
    finally:
        designer.close()
    return 0


def _serve(
    opening: Opening, designer: Designer, port: int, out: Path, *, browser: bool, on_note: Callable[[str], None]
) -> None:
    # Imported while the designer's processes load their modules.
    from mirrorcam.studio.jobs import Jobs
    from mirrorcam.studio.local_server import listening_socket, run_server
    from mirrorcam.studio.page import PageStart, sweep_points
    from mirrorcam.studio.server import studio_app

    listening = listening_socket(port)
    if opening.layout is not None:
        designer.keep(opening.spec, opening.layout)
    designer.offer({outcome.spec: path for outcome, path in opening.sweep})
    start = PageStart(opening.spec, tuple(sweep_points([outcome for outcome, _ in opening.sweep])))
    jobs = Jobs(out)
    app = studio_app(start, designer, jobs, listening.getsockname()[1])
    try:
        run_server(app, listening, browser=browser, on_note=on_note, end=designer.close)
    finally:
        jobs.close()
