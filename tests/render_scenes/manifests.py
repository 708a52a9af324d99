"""Manifests of rendered sets, for tests of their readers."""

from __future__ import annotations

from mirrorcam.optics.geometry.boards import default_board
from mirrorcam.optics.geometry.tolerances import Tolerances
from mirrorcam.render_scenes.sets.dataset import Dataset, DepthRange
from mirrorcam.render_scenes.settings import SENSORS, RenderSettings
from mirrorcam.render_scenes.tabletop.tabletop_set import TabletopSet

REACHES = (
    DepthRange(nearest_mm=281, farthest_mm=560, tilt_deg=44),
    DepthRange(nearest_mm=0, farthest_mm=0, tilt_deg=0),
)


def dataset_of_two_frames() -> Dataset:
    """The manifest of a set of two frames and one of the bare camera, without files."""
    return Dataset(
        layout_identity="0123456789abcdef",
        board=default_board(),
        frames=2,
        base_frames=1,
        width_px=1920,
        height_px=1080,
        tolerances=Tolerances(),
        settings=RenderSettings(),
        renderer="mitsuba",
        coverage=(0.5, 1.0),
        reaches=REACHES,
        base_coverage=0.9,
        request="abc",
    )


def scene_of_two_depths() -> TabletopSet:
    """The manifest of a tabletop scene, without files."""
    return TabletopSet(
        layout_identity="0123456789abcdef",
        depths_mm=(300.0, 600.0),
        meshes=(),
        width_px=1920,
        height_px=1080,
        tolerances=Tolerances(),
        sensor=SENSORS["c920"],
        spp=4,
        mirror_reflectance=0.9,
        renderer="mitsuba",
        central_view=(1, 1),
        request="abc",
    )
