"""What a page asks a server, checked; and the answers to what is refused."""

from __future__ import annotations

from typing import TypeVar

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.types import HTTPExceptionHandler

from mirrorcam.core.disk.files import validated
from mirrorcam.core.disk.nested_text import json_value
from mirrorcam.core.values import InputError, Value
from mirrorcam.studio.local_access import BodyTooLarge

Asked = TypeVar("Asked", bound=Value)


async def asked(model: type[Asked], request: Request) -> Asked:
    """The value in the body of a request, as JSON. Raises InputError for another.

    It is parsed in a thread, so that other requests are answered meanwhile; `LocalAccess` bounds the body's size.
    """
    return await run_in_threadpool(_value, model, await request.body())


def _value(model: type[Asked], body: bytes) -> Asked:
    return validated(model, json_value(body))


async def _refused(request: Request, error: Exception) -> Response:
    return PlainTextResponse(str(error), status_code=422)


async def _too_large(request: Request, error: Exception) -> Response:
    return PlainTextResponse(str(error), status_code=413)


REFUSALS: dict[type[Exception], HTTPExceptionHandler] = {InputError: _refused, BodyTooLarge: _too_large}
"""How both servers answer what is wrong with a request: one line, as text."""
