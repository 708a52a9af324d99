"""Serve the page of a design, its device and its camera on the loopback address until Ctrl-C."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

from mirrorcam.designs.design_files import read_request
from mirrorcam.designs.design_sweep import finished_designs
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.studio.designer import Designer
from mirrorcam.studio.live.values import LiveRequest


@dataclass(frozen=True)
class Opening:
    """Initial content of the page.

    Attributes
    ----------
    spec, layout
        A request, and its layout if it was solved before.
    sweep
        The files of the designs of a sweep.
    fragment
        The part after # of the page's address: a design, a tab, or both.
    camera, board
        The camera to open, and the board of its calibration pictures.
    """

    spec: DesignSpec
    layout: Layout | None = None
    sweep: Mapping[DesignSpec, Path] = field(default_factory=dict)
    fragment: str = ""
    camera: LiveRequest | None = None
    board: Path | None = None


def opened(design: Path | str | None) -> Opening:
    """Read a designed layout, a request, the designs in the folder of a sweep, or the link of a page.

    Raises a one-line InputError.
    """
    if design is None:
        return Opening(DesignSpec())
    _, is_link, fragment = str(design).partition("#")
    if is_link:
        return Opening(DesignSpec(), fragment=fragment)
    path = Path(design)
    if path.is_dir():
        designs = finished_designs(path)
        return Opening(next(iter(designs)), sweep=designs)
    spec = read_request(path).spec
    layout = Layout.load(path) if "mirrors" in path.read_text(encoding="utf-8") else None
    return Opening(spec, layout if layout is not None and layout.verdict and layout.kind == "nominal" else None)


def serve(opening: Opening, *, port: int | None, out: Path, browser: bool, on_note: Callable[[str], None]) -> int:
    """Serve until Ctrl-C, and return 0. Raises InputError for a port in use, or a camera that cannot be opened."""
    with ExitStack() as ending:
        designer = Designer()
        ending.callback(designer.close)
        designer.start(at_once=opening.camera is None)
        # Imported while the designer's processes load their modules.
        from mirrorcam.studio.jobs import Jobs
        from mirrorcam.studio.live.answers import CameraHost
        from mirrorcam.studio.local_server import DEFAULT_PORT, listening_socket, run_server
        from mirrorcam.studio.server import studio_app

        listening = ending.enter_context(listening_socket(port))
        own_port = listening.getsockname()[1]
        if opening.layout is not None:
            designer.keep(opening.spec, opening.layout)
        designer.offer(opening.sweep)
        jobs = Jobs(out)
        ending.callback(jobs.close)
        camera = CameraHost(jobs, on_note)
        ending.callback(camera.close)
        if opening.camera is not None:
            camera.open(opening.camera, opening.board)
        if port is None and own_port != DEFAULT_PORT:
            on_note(f"port {DEFAULT_PORT} is in use, {own_port} is not")

        def end() -> None:
            designer.close()
            camera.close()

        app = studio_app(opening.spec, designer, jobs, camera, own_port)
        run_server(app, listening, browser=browser, on_note=on_note, end=end, fragment=opening.fragment)
    return 0
