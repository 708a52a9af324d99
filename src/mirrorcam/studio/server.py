"""The studio's server: its page, and the answers to what the page asks."""

from __future__ import annotations

import json
from collections.abc import Awaitable, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Route

from mirrorcam.optics.base.files import one_line
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.studio.design_work import SolvedDesign
from mirrorcam.studio.designer import Designer, Superseded
from mirrorcam.studio.local_access import BodyTooLarge, LocalAccess
from mirrorcam.studio.page import studio_page

Answer = Callable[[Request], Awaitable[Response]]


class BadRequest(Exception):
    """A request that cannot be answered; the message says why in one line."""


async def asked_spec(request: Request) -> DesignSpec:
    """The spec in the body of a request; raises BadRequest."""
    try:
        return DesignSpec.model_validate_json(await request.body(), strict=True)
    except ValidationError as error:
        raise BadRequest(one_line(error, DesignSpec)) from None


def studio_app(spec: DesignSpec, designer: Designer, port: int, out: Path) -> Starlette:
    """The application: `spec` is what the page begins with, `out` the folder of what it makes."""

    async def page(request: Request) -> Response:
        return HTMLResponse(studio_page(spec, nonce=request.scope["nonce"]))

    async def preview(request: Request) -> Response:
        drawing = await run_in_threadpool(designer.preview, await asked_spec(request))
        return _json({"drawing": None if drawing is None else drawing.model_dump(mode="json")})

    async def design(request: Request) -> Response:
        try:
            wanted = await asked_spec(request)
        except BadRequest as error:
            return JSONResponse({"status": "refused", "constraint": "", "finding": str(error)})
        try:
            found = await run_in_threadpool(designer.solve, wanted)
        except Superseded:
            return JSONResponse({"status": "superseded"})
        if isinstance(found, SolvedDesign):
            parabola = None if found.parabola is None else found.parabola.model_dump(mode="json")
            return _json({"status": "solved", "drawing": found.drawing.model_dump(mode="json"), "parabola": parabola})
        return JSONResponse({"status": "refused", "constraint": found.constraint, "finding": found.finding})

    @asynccontextmanager
    async def lifespan(app: Starlette) -> Any:
        yield
        designer.close()

    return Starlette(
        routes=[
            Route("/", page),
            Route("/preview", preview, methods=["POST"]),
            Route("/design", design, methods=["POST"]),
        ],
        middleware=[Middleware(LocalAccess, port=port)],
        exception_handlers={BadRequest: _bad_request, BodyTooLarge: _too_large},
        lifespan=lifespan,
    )


def _json(value: Any) -> Response:
    return Response(json.dumps(value, allow_nan=False), media_type="application/json")


async def _bad_request(request: Request, error: Exception) -> Response:
    return PlainTextResponse(str(error), status_code=422)


async def _too_large(request: Request, error: Exception) -> Response:
    return PlainTextResponse(str(error), status_code=413)
