"""The page of `mirrorcam live`: one HTML file with its styles and scripts in itself."""

from __future__ import annotations

from dataclasses import asdict

from mirrorcam.core.html.templates import render
from mirrorcam.studio.live.engine import LEAST_PICTURES, LiveEngine
from mirrorcam.studio.page import WEB, script_json

SCRIPTS = ("dom.js", "server.js", "live_pictures.js", "live_meters.js", "live.js")


def live_page(engine: LiveEngine, *, nonce: str) -> str:
    """The page that a server gives; only scripts and styles with the nonce run."""
    start = {
        "about": asdict(engine.about),
        "outlines": engine.outlines_px(),
        "board": engine.board is not None,
        "least_pictures": LEAST_PICTURES,
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
