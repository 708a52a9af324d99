"""A small rendered set, which is made in a second, and the content of its folder."""

from __future__ import annotations

from pathlib import Path

from mirrorcam.optics.geometry.boards import Charuco
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.sets.set_request import SetRequest
from mirrorcam.render_scenes.settings import RenderSettings

BOARD = Charuco(cols=8, rows=6, square_mm=30.0, marker_mm=22.5)
SCALE = 8.0


def small_set_request(layout: Layout) -> SetRequest:
    """Six frames and two base frames by the fast renderer, with a layout before a sensor of 240 x 136 pixels."""
    full = layout.camera
    focal = {"fx_px": full.fx_px / SCALE, "fy_px": full.fy_px / SCALE}
    camera = Camera(width_px=240, height_px=136, cx_px=119.5, cy_px=67.5, **focal)
    settings = RenderSettings(renderer="fast")
    return SetRequest(
        layout=layout.replaced(camera=camera), board=BOARD, frames=6, base_frames=2, seed=5, settings=settings
    )


def contents(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
