"""Layouts of devices that gravity deforms: the motion of each mirror under gravity given in the camera's frame."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field
from scipy.spatial.transform import Rotation

from mirrorcam.core.disk.files import LARGEST_LAYOUT_BYTES, read_model, write_text
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray, Shaped, Value
from mirrorcam.optics.geometry.layout import Layout

MAX_G = 3.0  # 1 g is a unit vector; a robot that accelerates may exceed it


class MirrorMotion(Value):
    """Motion of one mirror relative to the camera: matrices (3, 3) that multiply gravity (in g, rig frame).

    Attributes
    ----------
    shift_mm : shift of the mean of the mirror's outline.
    turn_rad : rotation vector of the mirror about that point.
    plane_mm : resulting shift of the virtual centre of a first-surface mirror.
    """

    shift_mm: Annotated[FloatArray, Shaped((3, 3))]
    turn_rad: Annotated[FloatArray, Shaped((3, 3))]
    plane_mm: Annotated[FloatArray, Shaped((3, 3))]


class GravityTable(Value):
    """Motions of a device's mirrors relative to its camera under gravity, to correct its layout for a robot's pose.

    The content of `robot/gravity.json`. Keys of `mirrors` are `Layout.mirror_names`; motions are linear in gravity.
    """

    schema_id: Literal["mirrorcam.gravity/1"] = Field(default="mirrorcam.gravity/1", alias="schema")
    mirrors: Mapping[str, MirrorMotion]
    plastic: str = ""
    modulus_mpa: float = Field(default=2300.0, gt=0.0)

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a table; raises InputError for an invalid file."""
        return read_model(cls, path, LARGEST_LAYOUT_BYTES)

    def save(self, path: Path) -> None:
        """Write the table atomically."""
        write_text(path, self.text())

    def text(self) -> str:
        """The content of its file."""
        return self.model_dump_json(indent=1, by_alias=True) + "\n"


def layout_in_pose(
    layout: Layout, table: GravityTable, gravity_in_rig: FloatArray, calibrated_in_rig: FloatArray | None = None
) -> Layout:
    """Correct a layout for the deformation of its device under gravity.

    Parameters
    ----------
    layout : Layout
        The device's layout, calibrated or nominal.
    table : GravityTable
        Motions of its mirrors under gravity.
    gravity_in_rig : (3,) array
        Gravity in the pose, in g, in the rig frame: (0, 1, 0) if the image is upright.
    calibrated_in_rig : (3,) array or None
        Gravity during the calibration; None for a nominal layout, which describes the device without gravity.

    Returns
    -------
    Layout
        The layout with each mirror moved by the difference between the two motions, without metrics.

    Raises
    ------
    InputError
        If the table is for other mirrors, or gravity is not a vector with a norm of at most 3 g.
    """
    if set(table.mirrors) != set(layout.mirror_names):
        raise InputError(
            f"gravity table: mirrors {', '.join(sorted(table.mirrors))}, "
            f"expected the layout's mirrors {', '.join(layout.mirror_names)}"
        )
    change = _gravity(gravity_in_rig) - (_gravity(calibrated_in_rig) if calibrated_in_rig is not None else 0.0)
    mirrors = []
    for name, mirror in zip(layout.mirror_names, layout.mirrors, strict=True):
        motion = table.mirrors[name]
        rotation = Rotation.from_rotvec(motion.turn_rad @ change).as_matrix()
        mirrors.append(mirror.moved(rotation, motion.shift_mm @ change))
    return layout.replaced(
        kind="as-built" if layout.kind == "nominal" else layout.kind, mirrors=tuple(mirrors), metrics={}, verdict={}
    )


def _gravity(vector: FloatArray) -> FloatArray:
    gravity = np.asarray(vector, dtype=np.float64)
    if gravity.shape != (3,) or not np.isfinite(gravity).all() or np.linalg.norm(gravity) > MAX_G:
        raise InputError(
            f"gravity {gravity.tolist()}, expected a vector of 3 numbers with a norm of at most {MAX_G:g} g"
        )
    return gravity


def image_shifts_px(layout: Layout, displaced: Layout, depth_mm: float) -> list[FloatArray]:
    """Shifts (n, 2), px, of the scene's image in each sub-image between a layout and one with moved mirrors.

    The scene points lie at `depth_mm` in view axes, where the layout shows them at the corners and at the centre of
    each mirror.
    """
    shifts = []
    forward = layout.view_from_rig[2]
    for index, mirror in enumerate(layout.mirrors):
        apparent = mirror.apparent
        corners = mirror.usable_normalized
        normalized = np.vstack([corners, corners.mean(axis=0)])
        rays = np.column_stack([normalized, np.ones(len(normalized))]) @ apparent.reflection.T
        centre = apparent.virtual_centre_in_rig_mm
        points = centre + ((depth_mm - centre @ forward) / (rays @ forward))[:, None] * rays
        shifts.append(displaced.project(points, index) - layout.project(points, index))
    return shifts
