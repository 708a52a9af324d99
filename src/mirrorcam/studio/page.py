"""The studio's page: one HTML file with its styles and scripts in itself."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from markupsafe import Markup

from mirrorcam.cad.plan.back_table import BACKS
from mirrorcam.core.html.templates import render
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.studio.controls import control_groups, snapping_groups
from mirrorcam.studio.sweep_points import SweepPoint

WEB = Path(__file__).parent / "web"
SCRIPTS = (
    "three.bundle.js",
    "dom.js",
    "spec.js",
    "panels.js",
    "view3d.js",
    "controls.js",
    "figures.js",
    "compare.js",
    "tolerance.js",
    "sweep.js",
)


@dataclass(frozen=True)
class PageStart:
    """What the page begins with: a request, and the designs of a sweep to choose from."""

    spec: DesignSpec
    sweep: tuple[SweepPoint, ...] = ()


def studio_page(begin: PageStart, folder: Path, *, nonce: str) -> str:
    """The page that a server gives, which writes into a folder; only scripts and styles with the nonce run."""
    start = {
        "spec": begin.spec.model_dump(mode="json"),
        "defaults": DesignSpec().model_dump(mode="json"),
        "controls": [group.model_dump(mode="json") for group in control_groups(begin.spec)],
        "sweep": [point.model_dump(mode="json") for point in begin.sweep],
    }
    scripts = [*SCRIPTS, "server.js", "sight.js", "make.js", "main.js"]
    return render(
        WEB,
        "studio.html",
        start=script_json(start),
        scripts=scripts,
        nonce=nonce,
        makes_into=str(folder),
        adapters={kind: table.title for kind, table in BACKS.items()},
        atlas="",
    )


def snapshot_page(spec: DesignSpec, atlas: dict[str, Any]) -> str:
    """The page without a server: one file that shows the designs of an atlas, beginning with the nearest to `spec`."""
    groups = snapping_groups(atlas["axes"])
    controls = [group.model_dump(mode="json") for group in groups]
    defaults = DesignSpec().model_dump(mode="json")
    start = {"spec": spec.model_dump(mode="json"), "defaults": defaults, "controls": controls, "sweep": []}
    return render(
        WEB,
        "studio.html",
        start=script_json(start),
        atlas=script_json(atlas),
        scripts=[*SCRIPTS, "snapshot.js", "main.js"],
        nonce="",
        makes_into="",
        adapters={},
    )


def script_json(value: Any) -> Markup:
    """JSON for a script element, which no text in it can end."""
    return Markup(json.dumps(value, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c"))
