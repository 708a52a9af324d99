"""A layout as gravity bends its device: which way down is in the camera's frame, and what each mirror does then."""

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

# Gravity of 1 g is a unit vector; a robot that moves may have a little more, one in free fall none.
MOST_G = 3.0


class MirrorMotion(Value):
    """Motion of one mirror against the camera per gravity: matrices (3, 3) on its direction in rig, of 1 g.

    `shift_mm` is that of the mean of its outline, `turn_rad` its turn about that as a rotation vector. `plane_mm` is
    what the two do to the mirror's three numbers, its virtual centre, of a first-surface mirror.
    """

    shift_mm: Annotated[FloatArray, Shaped((3, 3))]
    turn_rad: Annotated[FloatArray, Shaped((3, 3))]
    plane_mm: Annotated[FloatArray, Shaped((3, 3))]


class GravityTable(Value):
    """How gravity moves the mirrors of a device against its camera, to correct its layout for a robot's pose.

    Read from `robot/gravity.json`. `mirrors` are by name, as in `Layout.mirror_names`; motions are linear in gravity.
    """

    schema_id: Literal["mirrorcam.gravity/1"] = Field(default="mirrorcam.gravity/1", alias="schema")
    mirrors: Mapping[str, MirrorMotion]
    plastic: str = ""
    modulus_mpa: float = Field(default=2300.0, gt=0.0)

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a table; raises InputError where the file is none."""
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
    """The layout as gravity bends it.

    Parameters
    ----------
    layout : Layout
        Of the device, calibrated or nominal.
    table : GravityTable
        What gravity does to its mirrors.
    gravity_in_rig : (3,) array
        Gravity in the pose, in g, in rig: (0, 1, 0) where the image's down is down.
    calibrated_in_rig : (3,) array or None
        Gravity when it was calibrated; none for a nominal layout, which is that without gravity.

    Returns
    -------
    Layout
        With every mirror moved by the difference, its metrics left out.

    Raises
    ------
    InputError
        If the table is of other mirrors, or a gravity no vector of 3 g at most.
    """
    if set(table.mirrors) != set(layout.mirror_names):
        raise InputError(
            f"gravity table: mirrors {', '.join(sorted(table.mirrors))}, "
            f"expected those of the layout, {', '.join(layout.mirror_names)}"
        )
    change = _gravity(gravity_in_rig) - (_gravity(calibrated_in_rig) if calibrated_in_rig is not None else 0.0)
    mirrors = []
    for name, mirror in zip(layout.mirror_names, layout.mirrors, strict=True):
        motion = table.mirrors[name]
        turn = Rotation.from_rotvec(motion.turn_rad @ change).as_matrix()
        mirrors.append(mirror.moved(turn, motion.shift_mm @ change))
    return layout.replaced(
        kind="as-built" if layout.kind == "nominal" else layout.kind, mirrors=tuple(mirrors), metrics={}, verdict={}
    )


def _gravity(vector: FloatArray) -> FloatArray:
    found = np.asarray(vector, dtype=np.float64)
    if found.shape != (3,) or not np.isfinite(found).all() or np.linalg.norm(found) > MOST_G:
        raise InputError(f"gravity {found.tolist()}, expected 3 numbers in g, {MOST_G:g} g long at most")
    return found


def image_shifts_px(layout: Layout, moved: Layout, depth_mm: float) -> list[FloatArray]:
    """How far images of the scene move in each sub-image, (n, 2) in px, from a layout to one whose mirrors moved.

    Of points of the scene at a depth in view axes, in mm: those that the layout shows at the corners and in the middle
    of each mirror.
    """
    shifts = []
    forward = layout.view_from_rig[2]
    for index, mirror in enumerate(layout.mirrors):
        apparent = mirror.apparent
        corners = mirror.usable_normalized
        seen = np.vstack([corners, corners.mean(axis=0)])
        rays = np.column_stack([seen, np.ones(len(seen))]) @ apparent.reflection.T
        start = apparent.virtual_centre_in_rig_mm
        points = start + ((depth_mm - start @ forward) / (rays @ forward))[:, None] * rays
        shifts.append(moved.project(points, index) - layout.project(points, index))
    return shifts
