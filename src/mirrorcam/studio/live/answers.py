"""Responses about the camera on the page: its session, the newest pictures, and orders."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, get_args

from pydantic import Field
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import Value
from mirrorcam.optics.calibration.diagnostics.verdict import MIN_FRAMES
from mirrorcam.studio.jobs import CALIBRATIONS, JobReport, Jobs, calibration_plan
from mirrorcam.studio.live.engine import LiveEngine
from mirrorcam.studio.live.values import LiveRequest, PictureKind
from mirrorcam.studio.local_server import as_json, posted

WAIT_S = 2.0
"""Maximum wait for a picture before the page repeats its request."""
IDLE_S = 3.0
"""Time after which pictures that no page requests are no longer made."""

Action = Literal["play_again", "focus", "align", "reset_focus", "record", "stop_recording", "take_picture"]


class LiveOrder(Value):
    """An order of the page; `depth_mm` belongs to focus, and `on` to align."""

    action: Action
    depth_mm: float = Field(default=math.nan, ge=0.0)
    on: bool = False


class CameraHost:
    """The session of the page's camera: none at first, then the one opened last; any thread may call.

    Parameters
    ----------
    jobs
        Jobs of the page; recordings, pictures and calibrations go below their root.
    on_note
        Called with each message of a session.
    """

    def __init__(self, jobs: Jobs, on_note: Callable[[str], None] = lambda line: None) -> None:
        self.jobs, self._on_note, self._lock = jobs, on_note, threading.Lock()
        self._engine: LiveEngine | None = None
        self._count = 0

    @property
    def engine(self) -> LiveEngine:
        """The session. Raises InputError without one."""
        if self._engine is None:
            raise InputError("no camera is open, expected one: open it on the tab Camera")
        return self._engine

    def open(self, request: LiveRequest, board: Path | None) -> LiveEngine:
        """Replace the session. A finite source starts when a page first requests pictures.

        Raises InputError if something cannot be opened.
        """
        with self._lock:
            self._close()
            self._engine = LiveEngine(
                request, out=self.jobs.root, board=board, idle_s=IDLE_S, hold=True, on_note=self._on_note
            )
            self._count += 1
            return self._engine

    def close(self) -> None:
        """End the session."""
        with self._lock:
            self._close()

    def _close(self) -> None:
        if self._engine is not None:
            self._engine.close()
            self._engine = None

    @property
    def about(self) -> dict[str, Any] | None:
        """Properties of the session that do not change, with its `number`; None without one."""
        with self._lock:
            engine = self._engine
            if engine is None:
                return None
            return {
                "number": self._count,
                "about": engine.about,
                "outlines": engine.outlines_px(),
                "board": engine.board is not None,
                "min_pictures": MIN_FRAMES,
            }

    @property
    def status(self) -> dict[str, Any] | None:
        """State of the session, with the `number` of `about`; None without one."""
        engine = self._engine
        if engine is None:
            return None
        return vars(engine.status()) | {"number": self._count, "focus_mm": engine.focus_mm}

    @property
    def layouts(self) -> list[str]:
        """The layout of the session, and calibrated ones below the root, the newest first."""
        found = sorted((self.jobs.root / CALIBRATIONS).glob("*/layout.json"), reverse=True)
        own = [] if self._engine is None else [self._engine.request.layout]
        return list(dict.fromkeys(map(str, [*own, *found])))

    def calibrate(self) -> JobReport:
        """Start to calibrate from the pictures taken.

        Raises InputError without a board, with fewer pictures than the report needs, and while one runs.
        """
        engine = self.engine
        if engine.board is None:
            raise InputError("no board is stated, expected a board.toml when the camera is opened")
        if (count := engine.status().pictures_kept) < MIN_FRAMES:
            raise InputError(f"number of calibration pictures is {count}, expected {MIN_FRAMES} or more")
        return self.jobs.start(calibration_plan(self.jobs.root, engine.board, engine.request.layout))


class CameraAnswers:
    """Responses to requests about the camera."""

    def __init__(self, host: CameraHost) -> None:
        self._host = host

    async def about(self, request: Request) -> Response:
        """Return the session, and the layouts with which one can be opened."""
        session = await run_in_threadpool(lambda: self._host.about)
        return as_json({"session": session, "layouts": self._host.layouts})

    async def picture(self, request: Request) -> Response:
        """Wait for a picture with a higher serial number; status 204 if none arrives in time."""
        kind, after = request.path_params["kind"], request.query_params.get("after", "0")
        if kind not in get_args(PictureKind) or not (after.isascii() and after.isdigit() and len(after) < 16):
            return PlainTextResponse("not found", status_code=404)
        engine = self._host.engine
        engine.begin()
        picture = await run_in_threadpool(engine.wait_for, kind, int(after), WAIT_S)
        if picture is None:
            return Response(status_code=204)
        headers = {"X-Serial": str(picture.serial), "X-Frame": str(picture.frame), "X-Time": f"{picture.time_s:.3f}"}
        return Response(picture.jpeg, media_type="image/jpeg", headers=headers)

    async def depth(self, request: Request) -> Response:
        """Return the depth, mm, at fractions of the reference view's width and height; null if unknown."""
        picture, query = self._host.engine.latest("depth"), request.query_params
        try:
            right, down = float(query["right"]), float(query["down"])
        except (KeyError, ValueError):
            return PlainTextResponse("expected right and down, from 0 to 1", status_code=422)
        if picture is None or picture.depth_mm is None or not (0.0 <= right <= 1.0 and 0.0 <= down <= 1.0):
            return as_json({"depth_mm": None})
        height, width = picture.depth_mm.shape
        value = int(picture.depth_mm[min(int(down * height), height - 1), min(int(right * width), width - 1)])
        return as_json({"depth_mm": value or None})

    async def order(self, request: Request) -> Response:
        order, engine = await posted(LiveOrder, request), self._host.engine
        actions: dict[Action, Callable[[], object]] = {
            "play_again": engine.play_again,
            "focus": lambda: engine.focus(order.depth_mm),
            "align": lambda: engine.align(order.on),
            "reset_focus": engine.reset_focus_meter,
            "record": engine.record,
            "stop_recording": engine.stop_recording,
            "take_picture": engine.take_picture,
        }
        result = await run_in_threadpool(actions[order.action])
        return as_json({"path": result if isinstance(result, Path) else None})

    async def calibrate(self, request: Request) -> Response:
        return as_json(await run_in_threadpool(self._host.calibrate))

    @property
    def routes(self) -> list[Route]:
        return [
            Route("/camera", self.about),
            Route("/picture/{kind}", self.picture),
            Route("/depth", self.depth),
            Route("/order", self.order, methods=["POST"]),
            Route("/calibrate", self.calibrate, methods=["POST"]),
        ]
