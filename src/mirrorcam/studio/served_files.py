"""Files of a folder that a page may read, which may change or go while they are sent."""

from __future__ import annotations

import os
from collections.abc import MutableMapping
from pathlib import Path
from typing import Any

from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.responses import FileResponse, Response
from starlette.staticfiles import StaticFiles
from starlette.types import Message, Receive, Scope, Send


class ServedFiles(StaticFiles):
    """The regular files below a folder, which need not be there yet; anything else is not found."""

    def __init__(self, folder: Path) -> None:
        super().__init__(directory=folder, check_dir=False)

    async def check_config(self) -> None:
        return

    async def get_response(self, path: str, scope: Scope) -> Response:
        """The answer to a request; status 404 for what cannot be read."""
        try:
            return await super().get_response(path, scope)
        except OSError:  # such as a link to itself
            raise HTTPException(404) from None

    def file_response(
        self,
        full_path: str | os.PathLike[str],
        stat_result: os.stat_result,
        scope: MutableMapping[str, Any],
        status_code: int = 200,
    ) -> Response:
        """The answer that sends a file."""
        try:
            with Path(full_path).open("rb"):
                pass
        except OSError:
            raise HTTPException(404) from None
        answer = super().file_response(full_path, stat_result, scope, status_code)
        return _SentFile(full_path, status_code, stat_result=stat_result) if answer.status_code == 200 else answer


class _SentFile(FileResponse):
    """A file as long as its answer has stated; where it is gone or shorter by now, the answer breaks off."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        left, ended = 0, False

        async def as_stated(message: Message) -> None:
            nonlocal left, ended
            if message["type"] == "http.response.start":
                left = int(Headers(raw=message["headers"]).get("content-length", "0"))
                await send(message)
            elif scope["method"] == "HEAD":
                await send(message)
            elif not ended:
                body = message["body"][:left]
                left -= len(body)
                if left and not message.get("more_body", False):
                    raise OSError("the file is shorter than it was")
                ended = not left
                await send({**message, "body": body, "more_body": not ended})

        try:
            await super().__call__(scope, receive, as_stated)
        except OSError:
            return
