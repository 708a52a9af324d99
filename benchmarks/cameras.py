"""Devices for the cameras of the library, all files built and checked: `python -m benchmarks.cameras [CAMERA ...]`.

For each camera a layout of 2 x 2 mirrors is designed (for `board_38`, whose lens is any, the C920's), its device built
by all cores, and a line of a Markdown table printed: the table in docs/cad.md. A slicer's figures need one installed.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

from mirrorcam.cad.build import build_parts
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.optics.base.values import Metric
from mirrorcam.optics.base.worker_pool import cores
from mirrorcam.optics.design.optimise import design
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.camera_library import camera_names, library
from mirrorcam.optics.geometry.design_spec import DesignSpec

HEAD = (
    "camera",
    "held by",
    "clip",
    "printing",
    "least force at a point",
    "strain of the leaves",
    "put back to",
    "picture moves",
    "gap of clip and light",
    "checks passed",
)


def checked(name: str, folder: Path) -> dict[str, Metric]:
    """All checks and figures of a camera's device, whose files are built in a folder."""
    profile = library()[name]
    camera = profile.camera if profile.optics else Camera.c920()
    layout = design(DesignSpec(camera=camera, rows=2, cols=2))
    return build_parts(layout, folder, Hardware.model_validate({"camera": name}), workers=cores())


def row(name: str, checks: Mapping[str, Metric]) -> tuple[str, ...]:
    """The cells of a camera's line; "" where a figure is not known."""

    def figure(key: str, text: str) -> str:
        metric = checks.get(f"camera_clip.{key}")
        return text.format(metric.value) if metric else ""

    limited = [metric for metric in checks.values() if metric.limit is not None]
    strain = checks.get("camera_clip.leaf_strain")
    return (
        f"`{name}`",
        {"lips": "six points", "board": "screws"}[library()[name].body.held_by.kind],
        figure("print_g", "{:.0f} g"),
        figure("print_minutes", "{:.0f} min"),
        figure("contact_n", "{:.2f} N"),
        f"{100.0 * strain.value:.2f} %" if strain else "",
        figure("reclamped_mm", "{:.3f} mm, ") + figure("reclamped_deg", "{:.3f}°"),
        figure("reclamped_px", "{:.1f} px"),
        figure("light_gap_mm", "{:.1f} mm"),
        f"{sum(metric.passed is not False for metric in limited)} of {len(limited)}",
    )


def line(cells: tuple[str, ...]) -> str:
    """A line of a Markdown table."""
    return f"| {' | '.join(cells)} |"


def main(names: list[str]) -> None:
    print(line(HEAD))
    print("|---" * len(HEAD) + "|")
    for name in names:
        with TemporaryDirectory() as folder:
            checks = checked(name, Path(folder))
        print(line(row(name, checks)), flush=True)
        for key, metric in checks.items():
            if metric.passed is False:
                print(f"{name}: {key} is {metric.value:g}, limit {metric.limit:g}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    main(sys.argv[1:] or list(camera_names()))
