"""The compared cameras, from their published figures: geometry of their views, lens, price and frame rate.

The pupil, or the middle of several, is the origin; x is right, y down, z forward. All cameras look at one field, whose
centre is at z = FOCUS_MM. Views have their own resolution and are cropped to what shows the field at all depths.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.design.optimise import design
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.light_field.decoder import choose_views
from mirrorcam.optics.light_field.light_field import Views

NEAR_MM, FAR_MM = 250.0, 900.0
"""Depths that are searched."""
FOCUS_MM = 400.0
"""Depth at which all lenses are in focus, the harmonic mean of 300 and 600 mm, and at which views coincide."""
FIELD_MM = np.array([80.0, 50.0])
"""The field in which cameras are compared, at FOCUS_MM."""

ARRAY_STEP_MM = (96.0, 32.0)  # between webcams of 94 x 29 mm
PAIR_MM = 60.0
# Lytro Illum.
ILLUM_SENSOR_PX, ILLUM_PIXEL_MM, ILLUM_MICROLENS_MM = (7728, 5368), 0.0014, 0.020
ILLUM_VIEW_PX, ILLUM_F_NUMBER, ILLUM_RAYS = (625, 434), 2.0, 40e6
ILLUM_FIELD_MM = 184.0  # width at FOCUS_MM to which it is zoomed: as wide as the default mirror camera's
ILLUM_GROUP = 3  # pixels under a microlens, along each side, that one of the simulated 5 x 5 views stands for
# Intel RealSense D435, infrared pair.
D435_PX, D435_FOCAL_MM, D435_PIXEL_MM, D435_F_NUMBER, D435_BASELINE_MM = (1280, 720), 1.93, 0.003, 2.0, 50.0


@dataclass(frozen=True, eq=False, kw_only=True)
class ComparedCamera:
    """A camera and its published figures.

    Attributes
    ----------
    name
        Name, as in the table.
    views
        Views that are rendered, cropped to the field.
    exists
        Mask (t, s) of the views that the camera has.
    view_count
        Number of views, as published.
    view_px
        Width and height of a view that is not cropped.
    field_mm
        Width and height (2,) of the field that all views share at FOCUS_MM.
    aperture_mm
        Diameter of the pupil of one view.
    samples
        Samples of the sensor that one rendered sample averages.
    is_active
        Whether it sees infrared dots that it projects, in grey.
    price, rate
        Price, and frames per second.
    """

    name: str
    views: Views
    exists: FloatArray
    view_count: int
    view_px: tuple[int, int]
    field_mm: FloatArray
    aperture_mm: float
    samples: float = 1.0
    is_active: bool = False
    price: str
    rate: str

    @property
    def box_mm(self) -> FloatArray:
        """Corners (2, 3) of the box around the views, in the view frame."""
        positions = self.views.positions_mm[self.exists > 0]
        return np.stack([positions.min(axis=0), positions.max(axis=0)])

    @property
    def baseline_mm(self) -> FloatArray:
        """Extent (2,) of the views along x and y."""
        return np.ptp(self.box_mm, axis=0)[:2]


def cameras() -> Iterator[ComparedCamera]:
    """Yield the cameras in the order of the table."""
    yield _mirror_camera("MirrorCam, 3 x 3", 3, 3, "133 EUR")
    yield _mirror_camera("MirrorCam, 1 x 2", 1, 2, "133 EUR")
    yield _mirror_camera("MirrorCam, 2 x 2", 2, 2, "133 EUR")
    yield _illum()
    yield _webcams("nine webcams, 3 x 3", 3, 3, ARRAY_STEP_MM, "630 EUR")
    yield _webcams("two webcams, 60 mm", 1, 2, (PAIR_MM, 0.0), "140 EUR")
    yield _d435()


def _field_views(
    positions_mm: FloatArray, focal_px: float, centre_mm: FloatArray, common_mm: FloatArray, depth_mm: float = 0.0
) -> Views:
    """Return views of the field, as far as the camera's views show it.

    Parameters
    ----------
    positions_mm
        Positions (t, s, 3) relative to the reference view.
    focal_px
        Focal length of the reference view.
    centre_mm
        Centre (2,) of the field relative to the reference view.
    common_mm
        Width and height (2,) of the field that all views share at FOCUS_MM.
    depth_mm
        Depth of the reference view.
    """
    px_per_mm = focal_px / (FOCUS_MM - depth_mm)
    # The depth estimator needs, in all views, what lies at any depth that it searches.
    parallax = FOCUS_MM / NEAR_MM - 1.0
    wanted_mm = FIELD_MM + 2.0 * parallax * np.abs(positions_mm).max(axis=(0, 1))[:2]
    size = np.rint(np.minimum(wanted_mm, common_mm) * px_per_mm).astype(int)
    return Views(
        positions_mm=positions_mm,
        focal_px=focal_px,
        centre_px=(size - 1.0) / 2.0 - px_per_mm * centre_mm,
        width_px=int(size[0]),
        height_px=int(size[1]),
        reference_depth_mm=FOCUS_MM,
        reference_view_in_rig_mm=np.array([*-centre_mm, depth_mm]),
        view_from_rig=np.eye(3),
        layout_identity="",
    )


def _grid(rows: int, cols: int, step_mm: tuple[float, float]) -> FloatArray:
    """Return positions (t, s, 3) on an even grid, relative to the reference view."""
    columns, lines = np.meshgrid(np.arange(cols) - cols // 2, np.arange(rows) - rows // 2)
    return np.stack([step_mm[0] * columns, step_mm[1] * lines, 0.0 * lines], axis=-1)


def _mirror_camera(name: str, rows: int, cols: int, price: str) -> ComparedCamera:
    camera = Camera.c920()
    layout = design(DesignSpec(camera=camera, rows=rows, cols=cols))
    common = choose_views(layout, FOCUS_MM, "common")
    px_per_mm = common.focal_px / common.reference_distance_mm
    size = np.array([common.width_px, common.height_px])
    centre = ((size - 1.0) / 2.0 - common.centre_px) / px_per_mm
    return ComparedCamera(
        name=name,
        views=_field_views(
            common.positions_mm, common.focal_px, centre, size / px_per_mm, common.reference_view_depth_mm
        ),
        exists=np.ones((rows, cols)),
        view_count=rows * cols,
        view_px=(common.width_px, common.height_px),
        field_mm=size / px_per_mm,
        aperture_mm=camera.aperture_mm,
        price=price,
        rate="30",
    )


def _pinholes(
    name: str, positions_mm: FloatArray, px: tuple[int, int], focal_px: float, **published: Any
) -> ComparedCamera:
    """Return parallel cameras alike, at positions (t, s, 3) relative to the reference view."""
    flat = positions_mm.reshape(-1, 3)[:, :2]
    common = FOCUS_MM * np.array(px) / focal_px - np.ptp(flat, axis=0)
    defaults = {"exists": np.ones(positions_mm.shape[:2]), "view_count": len(flat), "field_mm": common}
    views = _field_views(positions_mm, focal_px, (flat.min(axis=0) + flat.max(axis=0)) / 2.0, common)
    return ComparedCamera(name=name, views=views, view_px=px, **(defaults | published))


def _webcams(name: str, rows: int, cols: int, step_mm: tuple[float, float], price: str) -> ComparedCamera:
    camera = Camera.c920()
    published = {"aperture_mm": camera.aperture_mm, "price": price, "rate": "30, not synchronised"}
    return _pinholes(name, _grid(rows, cols, step_mm), (camera.width_px, camera.height_px), camera.fx_px, **published)


def _illum() -> ComparedCamera:
    """The plenoptic camera: 5 x 5 views without the corners, which its round pupil lacks, for all its rays."""
    focal_mm = ILLUM_SENSOR_PX[0] * ILLUM_PIXEL_MM * FOCUS_MM / ILLUM_FIELD_MM
    pupil_mm = focal_mm / ILLUM_F_NUMBER
    across = ILLUM_MICROLENS_MM / ILLUM_PIXEL_MM
    step = pupil_mm * ILLUM_GROUP / across
    exists = np.ones((5, 5))
    exists[::4, ::4] = 0.0
    return _pinholes(
        "Lytro Illum",
        _grid(5, 5, (step, step)),
        ILLUM_VIEW_PX,
        ILLUM_VIEW_PX[0] * FOCUS_MM / ILLUM_FIELD_MM,
        exists=exists,
        view_count=225,
        field_mm=ILLUM_FIELD_MM * np.array(ILLUM_VIEW_PX) / ILLUM_VIEW_PX[0],
        aperture_mm=pupil_mm / across,
        samples=float(ILLUM_RAYS / (exists.sum() * np.prod(ILLUM_VIEW_PX))),
        price="1,599 USD in 2014, out of production",
        rate="stills",
    )


def _d435() -> ComparedCamera:
    return _pinholes(
        "RealSense D435",
        _grid(1, 2, (D435_BASELINE_MM, 0.0)),
        D435_PX,
        D435_FOCAL_MM / D435_PIXEL_MM,
        aperture_mm=D435_FOCAL_MM / D435_F_NUMBER,
        is_active=True,
        price="330 EUR",
        rate="30, up to 90 at 848 x 480",
    )
