"""The studio's server: its page, and responses about designs, jobs and the camera."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable
from contextlib import asynccontextmanager
from pathlib import Path, PurePath
from typing import Any, Literal, TypeVar

from pydantic import Field
from starlette.applications import Starlette
from starlette.background import BackgroundTask
from starlette.concurrency import iterate_in_threadpool, run_in_threadpool
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import FileResponse, HTMLResponse, PlainTextResponse, Response, StreamingResponse
from starlette.routing import BaseRoute, Mount, Route

from mirrorcam.cad.plan.back_table import Kind as Adapter
from mirrorcam.core.bounds import DEPTH_MM
from mirrorcam.core.errors import InputError
from mirrorcam.core.processes.worker_process import WorkerDied
from mirrorcam.core.values import Value
from mirrorcam.designs.design_files import request_of, request_toml
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.studio import design_work, sight_work
from mirrorcam.studio.design_values import DesignResult, RefusedDesign, SolvedDesign, TargetResult
from mirrorcam.studio.designer import Designer
from mirrorcam.studio.jobs import Jobs, plan, write_folder, zipped
from mirrorcam.studio.live.answers import CameraAnswers, CameraHost
from mirrorcam.studio.live.values import LiveRequest
from mirrorcam.studio.local_server import FILES, REFUSALS, Body, LocalAccess, ServedFiles, as_json, json_line, posted
from mirrorcam.studio.page import studio_page
from mirrorcam.studio.sight_work import Subject
from mirrorcam.studio.turns import PageRequest, Superseded

Result = TypeVar("Result")
Handler = Callable[[Request], Awaitable[Response]]
PAGE_HEADER = "x-page"
"""Header with the name of a page: its newest request replaces only its own earlier ones."""
MAX_NAME_LENGTH, MAX_NUMBER_LENGTH, MAX_PATH_LENGTH = 64, 16, 1000


class Opened(Value):
    """A file that the user opened on the page: name and text."""

    name: str = Field(max_length=300)
    text: str


class JobRequest(Value):
    """The files to build or render for a design, and the device's back."""

    kind: Literal["parts", "set", "run"]
    adapter: Adapter = "none"
    spec: DesignSpec


class SightRequest(Value):
    """The subject of a simulated frame, and the depth to focus on."""

    spec: DesignSpec
    subject: Subject
    depth_mm: float = DEPTH_MM.field(300.0)


class TargetRequest(Value):
    """The terms of a target, such as "0.3mm@400mm 90EUR", empty without one, and the request that it is for."""

    terms: str = Field(default="", max_length=300)
    spec: DesignSpec


def _values(model: type[Body], work: Callable[[Body], Value]) -> Handler:
    """Respond to a posted value with the result of work on it, as JSON."""

    async def answer(request: Request) -> Response:
        result = await run_in_threadpool(work, await posted(model, request))
        return as_json(result)

    return answer


def _text(work: Callable[[DesignSpec], str]) -> Handler:
    """Respond to the request for a design with a text."""

    async def answer(request: Request) -> Response:
        return PlainTextResponse(work(await posted(DesignSpec, request)))

    return answer


class DesignAnswers:
    """Responses about designs, and their files."""

    def __init__(self, designer: Designer) -> None:
        self._designer = designer

    async def preview(self, request: Request) -> Response:
        drawing = await run_in_threadpool(self._designer.preview, await posted(DesignSpec, request))
        return Response(f'{{"drawing": {drawing or "null"}}}', media_type="application/json")

    async def design(self, request: Request) -> Response:
        page_request = _page_request(request)  # first: a later request may be parsed sooner
        found: Iterable[float | DesignResult]
        try:
            found = self._designer.solve(await posted(DesignSpec, request), page_request)
        except InputError as error:
            found = [RefusedDesign("", str(error))]
        return self._lines(request, page_request, found, _design_answer)

    async def suggestions(self, request: Request) -> Response:
        page_request = _page_request(request)
        suggestions = self._designer.suggestions(await posted(DesignSpec, request), page_request)
        return self._lines(request, page_request, suggestions)

    async def target(self, request: Request) -> Response:
        page_request = _page_request(request)
        message = await posted(TargetRequest, request)
        search = self._designer.target(message.terms, message.spec, page_request)
        return self._lines(request, page_request, search, _target_answer)

    def _lines(
        self,
        request: Request,
        page_request: PageRequest,
        found: Iterable[Any],
        answer: Callable[[Any], Any] = lambda item: item,
    ) -> Response:
        """Stream the progress of work, from 0 to 1, and its results, one per line as they come."""

        def line(item: Any) -> bytes:
            return json_line({"progress": item} if isinstance(item, float) else answer(item)) + b"\n"

        async def lines() -> AsyncIterator[bytes]:
            async with self._cancelled_on_disconnect(request, page_request):
                async for text in iterate_in_threadpool(map(line, found)):
                    yield text

        return StreamingResponse(lines(), media_type="application/x-ndjson")

    async def tolerance(self, request: Request) -> Response:
        return as_json(await self._studied(request, design_work.tolerance))

    async def report(self, request: Request) -> Response:
        return PlainTextResponse(await self._studied(request, design_work.report))

    async def _studied(self, request: Request, work: Callable[[Layout], Result]) -> Result:
        """Return the result of work on the solved design of a request."""
        page_request = _page_request(request)
        spec = await posted(DesignSpec, request)
        async with self._cancelled_on_disconnect(request, page_request):
            return await run_in_threadpool(self._designer.studied, work, spec, page_request)

    @asynccontextmanager
    async def _cancelled_on_disconnect(self, request: Request, page_request: PageRequest) -> AsyncIterator[None]:
        """Cancel the request if its page disconnects within the block."""

        async def watch() -> None:
            while (await request.receive())["type"] != "http.disconnect":
                continue
            await run_in_threadpool(self._designer.leave, page_request)

        watching = asyncio.create_task(watch())
        try:
            yield
        finally:
            watching.cancel()

    @property
    def routes(self) -> list[Route]:
        designer, sight = self._designer, self._designer.sight
        answers: dict[str, Handler] = {
            "preview": self.preview,
            "design": self.design,
            "suggestions": self.suggestions,
            "target": self.target,
            "tolerance": self.tolerance,
            "report": self.report,
            "nearby": _values(TargetRequest, lambda sent: designer.nearby(sent.spec, sent.terms)),
            "frame": _values(SightRequest, lambda sent: sight(sight_work.frame, sent.spec, sent.subject)),
            "decoded": _values(SightRequest, lambda sent: sight(sight_work.decoded, sent.spec, sent.subject)),
            "refocused": _values(
                SightRequest, lambda sent: sight(sight_work.refocused, sent.spec, sent.subject, sent.depth_mm)
            ),
            "layout": _text(lambda spec: designer.solved(spec).layout.text()),
            "request": _text(request_toml),
            "opened": _values(Opened, lambda file: request_of(Path(PurePath(file.name).name), file.text.encode()).spec),
        }
        return [Route(f"/{name}", answer, methods=["POST"]) for name, answer in answers.items()]


class CameraRequest(Value):
    """A camera to open on the page: its source, its layout, and the board of its calibration pictures.

    The layout is a file, or a solved design.
    """

    source: str = Field(min_length=1, max_length=MAX_PATH_LENGTH)
    layout: str = Field(default="", max_length=MAX_PATH_LENGTH)
    spec: DesignSpec | None = None
    board: str = Field(default="", max_length=MAX_PATH_LENGTH)


class JobAnswers:
    """Responses about what is made with a design: jobs, their files, and the camera that it is used with."""

    def __init__(self, designer: Designer, jobs: Jobs, camera: CameraHost) -> None:
        self._designer, self._jobs, self._camera = designer, jobs, camera

    async def start(self, request: Request) -> Response:
        message = await posted(JobRequest, request)
        name = await run_in_threadpool(self._folder, message.spec)
        return as_json(self._jobs.start(plan(self._jobs.root, message.kind, name, message.adapter)))

    def _folder(self, spec: DesignSpec) -> str:
        return write_folder(self._jobs.root, self._designer.solved(spec).layout)

    async def state(self, request: Request) -> Response:
        """Return the jobs, and the state of the camera: everything that the page polls."""
        camera = await run_in_threadpool(lambda: self._camera.status)
        return as_json({"jobs": self._jobs.reports(), "camera": camera})

    async def open_camera(self, request: Request) -> Response:
        message = await posted(CameraRequest, request)
        if message.spec is not None:
            layout = self._jobs.root / await run_in_threadpool(self._folder, message.spec) / "layout.json"
        else:
            layout = Path(message.layout)
        live_request, board = LiveRequest(layout, message.source), Path(message.board) if message.board else None
        await run_in_threadpool(self._camera.open, live_request, board)
        return as_json({})

    async def cancel(self, request: Request) -> Response:
        number = request.path_params["number"]
        if not (number.isascii() and number.isdigit() and len(number) < MAX_NUMBER_LENGTH):
            return PlainTextResponse("not found", status_code=404)
        self._jobs.cancel(int(number))
        return as_json({})

    async def zip(self, request: Request) -> Response:
        name = request.path_params["name"]
        path = await run_in_threadpool(zipped, self._jobs.root, name)
        done = BackgroundTask(path.unlink)
        return FileResponse(
            path, filename=f"{name.replace('/', '-')}.zip", media_type="application/zip", background=done
        )

    @property
    def routes(self) -> list[BaseRoute]:
        return [
            Route("/state", self.state),
            Route("/camera", self.open_camera, methods=["POST"]),
            Route("/jobs", self.start, methods=["POST"]),
            Route("/jobs/{number}/cancel", self.cancel, methods=["POST"]),
            Route("/zip/{name:path}", self.zip),
            Mount(FILES, ServedFiles(self._jobs.root)),
        ]


def studio_app(spec: DesignSpec, designer: Designer, jobs: Jobs, camera: CameraHost, port: int) -> Starlette:
    """Return the application; `spec` is the initial request of the page."""
    answers = DesignAnswers(designer), JobAnswers(designer, jobs, camera), CameraAnswers(camera)

    async def page(request: Request) -> Response:
        return HTMLResponse(studio_page(spec, jobs.root, nonce=request.scope["nonce"]))

    return Starlette(
        routes=[Route("/", page), *(route for each in answers for route in each.routes)],
        middleware=[Middleware(LocalAccess, port=port)],
        exception_handlers=REFUSALS | {WorkerDied: _superseded, Superseded: _superseded},
    )


def _page_request(request: Request) -> PageRequest:
    """Return the page's request by the name in its header; without a name, each request counts as its own page."""
    name = request.headers.get(PAGE_HEADER)
    return PageRequest(object() if name is None else name[:MAX_NAME_LENGTH])


def _design_answer(result: DesignResult) -> dict[str, Any]:
    if isinstance(result, SolvedDesign):
        return {"status": "solved", "drawing": result.drawing}
    return {"status": "refused", "constraint": result.constraint, "finding": result.finding, "where": result.drawing}


def _target_answer(result: TargetResult) -> dict[str, Any]:
    return {"refusal": result.refusal, "designs": result.designs}


async def _superseded(request: Request, error: Exception) -> Response:
    return as_json(None)  # superseded: the page shows another design by now
