"""Serving the studio's page on the loopback address until Ctrl-C."""

from __future__ import annotations

import socket
import webbrowser
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import uvicorn

from mirrorcam.optics.base.values import InputError
from mirrorcam.optics.design.spec_grid import Outcome
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.studio.designer import Designer
from mirrorcam.studio.jobs import Jobs
from mirrorcam.studio.page import PageStart
from mirrorcam.studio.server import studio_app
from mirrorcam.studio.sweep_points import sweep_points
from mirrorcam.workflow.design_request import read_request
from mirrorcam.workflow.design_sweep import finished_designs

LOOPBACK = "127.0.0.1"
ENDING_S = 2
"""Time that answers which are under way have at the end."""


@dataclass(frozen=True)
class Opening:
    """What the page begins with: a request and, where it was solved before, its layout; and the designs of a sweep."""

    spec: DesignSpec
    layout: Layout | None = None
    sweep: tuple[tuple[Outcome, Path], ...] = ()


def opened(path: Path | None) -> Opening:
    """What a file or the folder of a sweep holds: a designed layout, a request alone, or many designs.

    Raises InputError in one line.
    """
    if path is None:
        return Opening(DesignSpec())
    if path.is_dir():
        designs = tuple(finished_designs(path))
        return Opening(designs[0][0].spec, sweep=designs)
    spec = read_request(path)
    layout = Layout.load(path) if "mirrors" in path.read_text(encoding="utf-8") else None
    return Opening(spec, layout if layout is not None and layout.verdict and layout.kind == "nominal" else None)


def _bound(port: int) -> socket.socket:
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((LOOPBACK, port))
        listening.listen()
    except OSError as error:
        listening.close()
        raise InputError(f"--port {port}: {error.strerror}, expected a free one, or 0 for any") from None
    return listening


class _Server(uvicorn.Server):
    """A server that ends what it waits for before it waits."""

    def __init__(self, config: uvicorn.Config, end: Callable[[], None]) -> None:
        super().__init__(config)
        self._end = end

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        self._end()
        await super().shutdown(sockets)


def serve(opening: Opening, *, port: int, out: Path, browser: bool, tell: Callable[[str], None]) -> int:
    """Serve until Ctrl-C; returns 0."""
    listening = _bound(port)
    address = f"http://{LOOPBACK}:{listening.getsockname()[1]}/"
    designer = Designer()
    designer.start()
    if opening.layout is not None:
        designer.keep(opening.spec, opening.layout)
    designer.offer({outcome.spec: path for outcome, path in opening.sweep})
    jobs = Jobs(out)
    start = PageStart(opening.spec, tuple(sweep_points([outcome for outcome, _ in opening.sweep])))
    app = studio_app(start, designer, jobs, listening.getsockname()[1])
    config = uvicorn.Config(app, log_level="warning", timeout_graceful_shutdown=ENDING_S, server_header=False)
    server = _Server(config, designer.close)
    tell(f"{address} (Ctrl-C ends it)")
    if browser:
        webbrowser.open(address)
    try:
        server.run(sockets=[listening])
    except KeyboardInterrupt:  # of uvicorn, which has ended by then
        tell("ended")
    finally:
        jobs.close()
        designer.close()
    return 0
