"""The server of `mirrorcam live`: its page, the newest pictures, and orders from the page."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any, Literal, get_args

from pydantic import Field
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import HTMLResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route

from mirrorcam.core.html.templates import render
from mirrorcam.core.values import Value
from mirrorcam.studio.live.engine import MIN_PICTURES, LiveEngine
from mirrorcam.studio.live.values import LiveRequest, PictureKind
from mirrorcam.studio.local_server import (
    FILES,
    REFUSALS,
    LocalAccess,
    ServedFiles,
    listening_socket,
    posted,
    run_server,
)
from mirrorcam.studio.page import WEB, script_json

SCRIPTS = ("dom.js", "server.js", "live_pictures.js", "live_meters.js", "live.js")


def live_page(engine: LiveEngine, *, nonce: str) -> str:
    """Render the page; the browser runs only scripts and styles with the nonce."""
    start = {
        "about": asdict(engine.about),
        "outlines": engine.outlines_px(),
        "board": engine.board is not None,
        "least_pictures": MIN_PICTURES,
    }
    return render(
        WEB,
        "live.html",
        start=script_json(start),
        scripts=SCRIPTS,
        nonce=nonce,
        about=engine.about,
        board=engine.board is not None,
        out=str(engine.out),
        layout=str(engine.request.layout),
    )


WAIT_S = 2.0
"""Maximum wait for a picture before the page repeats its request."""
IDLE_S = 3.0
"""Time after which pictures that no page requests are no longer made."""

Action = Literal["play_again", "focus", "align", "reset_focus", "record", "stop_recording", "take_picture", "calibrate"]


class LiveOrder(Value):
    """An order of the page; `depth_mm` belongs to focus, and `on` to align."""

    action: Action
    depth_mm: float = Field(default=math.nan, ge=0.0)
    on: bool = False


class LiveAnswers:
    """Responses about a live session."""

    def __init__(self, engine: LiveEngine) -> None:
        self._engine = engine

    async def page(self, request: Request) -> Response:
        return HTMLResponse(live_page(self._engine, nonce=request.scope["nonce"]))

    async def picture(self, request: Request) -> Response:
        """Wait for a picture with a higher serial number; status 204 if none arrives in time."""
        kind, after = request.path_params["kind"], request.query_params.get("after", "0")
        if kind not in get_args(PictureKind) or not (after.isascii() and after.isdigit() and len(after) < 16):
            return PlainTextResponse("not found", status_code=404)
        self._engine.begin()
        picture = await run_in_threadpool(self._engine.wait_for, kind, int(after), WAIT_S)
        if picture is None:
            return Response(status_code=204)
        headers = {"X-Serial": str(picture.serial), "X-Frame": str(picture.frame), "X-Time": f"{picture.time_s:.3f}"}
        return Response(picture.jpeg, media_type="image/jpeg", headers=headers)

    async def depth(self, request: Request) -> Response:
        """Return the depth, mm, at fractions of the reference view's width and height; null if unknown."""
        picture, query = self._engine.latest("depth"), request.query_params
        try:
            right, down = float(query["right"]), float(query["down"])
        except (KeyError, ValueError):
            return PlainTextResponse("expected right and down, from 0 to 1", status_code=422)
        if picture is None or picture.depth_mm is None or not (0.0 <= right <= 1.0 and 0.0 <= down <= 1.0):
            return as_json({"depth_mm": None})
        height, width = picture.depth_mm.shape
        value = int(picture.depth_mm[min(int(down * height), height - 1), min(int(right * width), width - 1)])
        return as_json({"depth_mm": value or None})

    async def status(self, request: Request) -> Response:
        return as_json(self._status())

    async def order(self, request: Request) -> Response:
        order, engine = await posted(LiveOrder, request), self._engine
        actions: dict[Action, Callable[[], object]] = {
            "play_again": engine.play_again,
            "focus": lambda: engine.focus(order.depth_mm),
            "align": lambda: engine.align(order.on),
            "reset_focus": engine.reset_focus_meter,
            "record": engine.record,
            "stop_recording": engine.stop_recording,
            "take_picture": engine.take_picture,
            "calibrate": engine.calibrate,
        }
        result = await run_in_threadpool(actions[order.action])
        return as_json({"path": str(result) if isinstance(result, Path) else None})

    def _status(self) -> dict[str, Any]:
        status = asdict(self._engine.status())
        calibration = status["calibration"]
        if calibration is not None and calibration["report"] is not None:
            inside = Path(calibration["report"]).relative_to(self._engine.out)
            calibration["page"] = f"{FILES}/{inside.as_posix()}"
        return status


def as_json(value: Any) -> Response:
    """Return a JSON response: paths as text, NaN and infinity as null."""
    return Response(json.dumps(plain(value), allow_nan=False), media_type="application/json")


def plain(value: Any) -> Any:
    """Convert a value to JSON types."""
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return str(value) if isinstance(value, Path) else value


def live_app(engine: LiveEngine, port: int) -> Starlette:
    """Return the application of one session."""
    answers = LiveAnswers(engine)
    return Starlette(
        routes=[
            Route("/", answers.page),
            Route("/picture/{kind}", answers.picture),
            Route("/depth", answers.depth),
            Route("/status", answers.status),
            Route("/order", answers.order, methods=["POST"]),
            Mount(FILES, ServedFiles(engine.out)),
        ],
        middleware=[Middleware(LocalAccess, port=port)],
        exception_handlers=REFUSALS,
    )


def serve_live(
    request: LiveRequest,
    *,
    out: Path,
    board: Path | None,
    port: int,
    browser: bool,
    on_note: Callable[[str], None],
) -> int:
    """Serve a session until Ctrl-C, and return 0. A finite source starts when a page first requests pictures.

    Raises InputError if something cannot be opened.
    """
    listening = listening_socket(port)
    with listening, LiveEngine(request, out=out, board=board, idle_s=IDLE_S, hold=True, on_note=on_note) as engine:
        app = live_app(engine, listening.getsockname()[1])
        run_server(app, listening, browser=browser, on_note=on_note, end=engine.close)
    return 0
