"""Match the cameras of a calibration to mirrors, and their pictures to pixels of the frame.

A mirror's picture is the frame, flipped: by default the flip that leaves views upright, which `mirrorcam camera export`
states. It is the complete flipped frame, the sub-image that `mirrorcam camera export` crops by the nominal layout, or a
rectangle whose position a views file states.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import Field

from mirrorcam.core.bounds import LINE_PX
from mirrorcam.core.disk.files import read_model
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray, Value
from mirrorcam.optics.camera_files.camera_rig import CameraRig, PictureFlip, RigCamera
from mirrorcam.optics.camera_files.write.pose_cameras import pose_cameras
from mirrorcam.optics.camera_files.write.virtual_cameras import (
    Flip,
    Rectangle,
    flip_axes,
    flipped_pixels,
    upright_flip,
    view_name,
    virtual_cameras,
)
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.transforms import rigid, transform


class ViewPosition(Value):
    """View of a camera, and position in the flipped frame of its pictures' first pixel."""

    view: str = Field(max_length=40)
    x: int = LINE_PX.field(0)
    y: int = LINE_PX.field(0)


class ViewsFile(Value):
    """Content of a views file, which maps cameras of a calibration to mirrors."""

    cameras: dict[str, str | ViewPosition] = Field(default_factory=dict, max_length=10_000)
    pictures: PictureFlip | None = None

    @classmethod
    def load(cls, path: Path) -> ViewsFile:
        """Read a TOML or JSON file; raises InputError if it is invalid."""
        return read_model(cls, path)


@dataclass(frozen=True, eq=False)
class MatchedView:
    """A camera of a calibration and its mirror.

    `flip` is the flip from the frame to its pictures (None: not flipped), `first_px` (2,) their first pixel in the
    flipped frame. `camera_from_rig` is the camera's pose, in mm if the unit is known.
    """

    view: int
    camera: RigCamera
    camera_from_rig: FloatArray | None
    flip: Flip | None
    first_px: FloatArray
    truth: Layout

    def project(self, points_in_camera: FloatArray) -> FloatArray:
        """Project points (n, 3) in camera coordinates to pixels (n, 2) of the unflipped frame."""
        pixels = self.camera.lens.project(points_in_camera) + self.first_px
        return pixels if self.flip is None else flipped_pixels(pixels, self.truth.camera, self.flip)

    @property
    def mirror(self) -> Mirror:
        """The true mirror."""
        return self.truth.mirrors[self.view]

    @property
    def name(self) -> str:
        """The name of the view in files."""
        return view_name(*divmod(self.view, self.truth.cols))

    @property
    def true_camera_from_rig(self) -> FloatArray:
        """Pose (4, 4), mm, of a perfect calibration of these pictures in the true rig; it may include a reflection."""
        axes = np.eye(3) if self.flip is None else flip_axes(self.flip)
        apparent = self.mirror.apparent
        return rigid(axes @ apparent.reflection, axes @ apparent.virtual_centre_in_rig_mm)

    def project_in_rig(self, points_in_rig: FloatArray) -> FloatArray:
        """Project points (n, 3) in the calibration's rig, or in a camera without pose, to frame pixels (n, 2)."""
        pose = self.camera_from_rig
        return self.project(points_in_rig if pose is None else transform(pose, points_in_rig))


def matched_views(
    rig: CameraRig, truth: Layout, nominal: Layout, views: ViewsFile | None = None, pictures: PictureFlip | None = None
) -> tuple[MatchedView, ...]:
    """Match the cameras of a calibration to mirrors, in the order of the mirrors.

    Parameters
    ----------
    rig
        The calibration.
    truth, nominal
        The layout as built, and the one given to the calibrator.
    views
        Content of a views file.
    pictures
        Flip of the pictures, if the user states it; otherwise that of the files, or else the upright one.

    Raises
    ------
    InputError
        For a camera without a mirror, two cameras of one mirror, or pictures of a different size.
    """
    stated = pictures or (views.pictures if views else None) or rig.pictures or "flipped"
    if pictures and rig.pictures and _flip(pictures, nominal) != _flip(rig.pictures, nominal):
        raise InputError(f"--flip {pictures}: the calibration states {rig.pictures}, expected the same or no --flip")
    flip = _flip(stated, nominal)
    listed = {} if views is None else views.cameras
    unknown = sorted(listed.keys() - {camera.name for camera in rig.cameras})
    if unknown:
        names = ", ".join(camera.name[:30] for camera in rig.cameras[:6])
        raise InputError(f"camera {unknown[0][:40]!r} of the views file is not in the calibration, which has {names}")
    matched: dict[int, MatchedView] = {}
    for camera in rig.cameras:
        position = listed.get(camera.name)
        if listed and position is None:
            continue
        position = ViewPosition(view=position) if isinstance(position, str) else position
        view = view_of(camera.name if position is None else position.view, nominal)
        if view in matched:
            both = f"{matched[view].camera.name[:40]!r} and {camera.name[:40]!r}"
            raise InputError(
                f"cameras {both} are both {view_name(*divmod(view, nominal.cols))}, expected one camera per view"
            )
        first = np.array(_first_pixel(camera, view, flip, nominal, position), dtype=np.float64)
        matched[view] = MatchedView(view, camera, _pose_mm(camera, rig), flip, first, truth)
    if not matched:
        raise InputError("no camera of the calibration is a mirror of the set")
    return tuple(matched[view] for view in sorted(matched))


def _pose_mm(camera: RigCamera, rig: CameraRig) -> FloatArray | None:
    if camera.camera_from_rig is None:
        return None
    pose = camera.camera_from_rig.copy()
    pose[:3, 3] *= rig.unit_mm or 1.0
    return pose


def _flip(pictures: PictureFlip, nominal: Layout) -> Flip | None:
    if pictures == "as-is":
        return None
    return upright_flip(nominal) if pictures == "flipped" else pictures


def view_of(name: str, layout: Layout) -> int:
    """Return the mirror that a camera's name states: `view_ROW_COLUMN`, "ROW-COLUMN", or a final number, row by row."""
    count = len(layout.mirrors)
    matches = re.findall(r"view_(\d{1,4})_(\d{1,4})", name)
    if len(matches) == 1:
        row, column = (int(rectangle) for rectangle in matches[0])
        if row < layout.rows and column < layout.cols:
            return row * layout.cols + column
    elif name in layout.mirror_names:
        return layout.mirror_names.index(name)
    elif not matches and (number := re.search(r"(\d{1,6})$", name)) and int(number[1]) < count:
        return int(number[1])
    last = view_name(*divmod(count - 1, layout.cols))
    raise InputError(
        f"camera {name[:40]!r} names no mirror, expected view_0_0 to {last}, 0 to {count - 1}, or --views FILE"
    )


def _first_pixel(
    camera: RigCamera, view: int, flip: Flip | None, nominal: Layout, position: ViewPosition | None
) -> tuple[int, int]:
    """Return the first pixel of a camera's pictures in the flipped frame."""
    width, height = nominal.camera.width_px, nominal.camera.height_px
    size = camera.size_px or (width, height)
    if position is not None and (position.x or position.y):
        if position.x + size[0] > width or position.y + size[1] > height:
            raise InputError(
                f"camera {camera.name[:40]!r}: {size[0]}x{size[1]} px at ({position.x}, {position.y}) is beyond the "
                f"frame of {width}x{height} px"
            )
        return position.x, position.y
    if size == (width, height):
        return 0, 0
    crops = _crops(nominal, view, flip)
    for crop in crops:
        if size == (crop.width, crop.height):
            return crop.x, crop.y
    sizes = " or ".join(f"{crop.width}x{crop.height}" for crop in crops)
    raise InputError(
        f"camera {camera.name[:40]!r}: pictures of {size[0]}x{size[1]} px, expected the frame's {width}x{height}, the "
        f"view's {sizes}, or x and y in --views FILE"
    )


def _crops(nominal: Layout, view: int, flip: Flip | None) -> list[Rectangle]:
    """Return the crops of the flipped frame that `mirrorcam camera export` writes for a view: tight, with margin."""
    views = virtual_cameras(nominal)
    name = views[view].name
    crops = [views[view].sub_image, *(camera.crop for camera in pose_cameras(nominal, views) if camera.name == name)]
    if flip == views[view].flip:
        return crops
    return [_flipped(_flipped(crop, nominal, views[view].flip), nominal, flip) for crop in crops]


def _flipped(rectangle: Rectangle, layout: Layout, flip: Flip | None) -> Rectangle:
    """Convert a rectangle of the frame to the flipped frame, or back."""
    x, y = rectangle.x, rectangle.y
    if flip == "left-right":
        x = layout.camera.width_px - rectangle.x - rectangle.width
    if flip == "top-bottom":
        y = layout.camera.height_px - rectangle.y - rectangle.height
    return Rectangle(x, y, rectangle.width, rectangle.height)
