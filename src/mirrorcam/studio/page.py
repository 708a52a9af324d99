"""The studio's page: one HTML file that contains its styles and scripts."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from markupsafe import Markup

from mirrorcam.cad.plan.back_table import BACKS
from mirrorcam.core.bounds import DEPTH_MM, SIDE_MM
from mirrorcam.core.html.templates import render
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.studio.controls import ControlGroup, control_groups, snapping_groups
from mirrorcam.studio.design_values import COMPARED

WEB = Path(__file__).parent / "web"
SCRIPTS = (
    "three.bundle.js",
    "dom.js",
    "spec.js",
    "panels.js",
    "scale.js",
    "view3d.js",
    "controls.js",
    "figures.js",
    "compare.js",
    "tolerance.js",
    "map.js",
)
SERVER_SCRIPTS = ("server.js", "sight.js", "target.js", "make.js", "live_pictures.js", "live_meters.js", "live.js")


def studio_page(spec: DesignSpec, folder: Path, *, nonce: str) -> str:
    """Render the page of a server that writes into a folder; browsers run only scripts and styles with the nonce."""
    scripts = (*SCRIPTS, *SERVER_SCRIPTS, "main.js")
    return _page(spec, control_groups(spec), scripts, nonce=nonce, makes_into=str(folder))


def snapshot_page(spec: DesignSpec, atlas: dict[str, Any]) -> str:
    """Render the page without a server: one file with the designs of an atlas, initially the nearest to `spec`."""
    scripts = (*SCRIPTS, "snapshot.js", "main.js")
    return _page(spec, snapping_groups(atlas["axes"]), scripts, atlas=script_json(atlas))


def _page(spec: DesignSpec, groups: Sequence[ControlGroup], scripts: Sequence[str], **blocks: Any) -> str:
    start = {
        "spec": spec.model_dump(mode="json"),
        "defaults": OPTIONAL | DesignSpec().model_dump(mode="json"),
        "compared": [each.model_dump() for each in COMPARED],
        "controls": [group.model_dump(mode="json") for group in groups],
    }
    adapters = {kind: table.title for kind, table in BACKS.items()}
    common = {"nonce": "", "makes_into": "", "atlas": "", "adapters": adapters, "side": SIDE_MM, "depth": DEPTH_MM}
    return render(WEB, "studio.html", start=script_json(start), scripts=scripts, **(common | blocks))


OPTIONAL: dict[str, Any] = {name: getattr(DesignSpec(), name) for name in ("size_step_mm", "same_size")}
"""Defaults of the fields that the JSON of a request omits then."""


def script_json(value: Any) -> Markup:
    """Return JSON that is safe inside a script element."""
    return Markup(json.dumps(value, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c"))
