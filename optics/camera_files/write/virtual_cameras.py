"""Mirrors as cameras for other tools: a pinhole with a lens, at a rigid pose, with a separate picture.

What the base camera sees in a mirror is what a camera at the virtual centre c would see, but mirrored. With the
mirror's unit normal n, S = I - 2 n n^T and reflect(x) = S x + c, the base camera projects S x + c, whose handedness is
wrong: det S = -1. Flipping the *frame* corrects it. Left and right exchanged, F = diag(-1, 1, 1), pixel column u
becomes W - 1 - u, and since the lens model obeys

    distort(-x, y; k, p1, -p2) = (-x_d, y_d)    where    (x_d, y_d) = distort(x, y; k, p1, p2)

the flipped frame is that of a camera with cx' = W - 1 - cx and p2' = -p2 that projects F (S x + c). Top and bottom
exchanged, F = diag(1, -1, 1), it is cy' = H - 1 - cy and p1' = -p1. Either way

    camera_from_rig = [F S | F c],    det F S = +1,    centre = -(F S)^T F c = -S c = c.

Of the two flips, a layout takes the one that leaves its views upright: top-bottom where mirrors above the camera fold
its view, left-right where it looks past mirrors at its side.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import shapely
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray, InputError, InvalidValue
from mirrorcam.optics.camera_files.write.nearest_pinhole import nearest_pinhole
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import rigid, transform

Flip = Literal["left-right", "top-bottom"]

POINTS_PER_EDGE = 16


@dataclass(frozen=True)
class Rectangle:
    """Pixels x .. x + width - 1 by y .. y + height - 1."""

    x: int
    y: int
    width: int
    height: int

    @property
    def slices(self) -> tuple[slice, slice]:
        """Rows and columns of an image (h, w, ...)."""
        return slice(self.y, self.y + self.height), slice(self.x, self.x + self.width)


@dataclass(frozen=True)
class VirtualCamera:
    """One mirror as a camera.

    `camera` has the intrinsics of the whole flipped frame, `camera_from_rig` (4, 4) is rigid, in mm. `outline_px`
    (n, 2) bounds what the mirror shows in the flipped frame, `sub_image` is its bounding rectangle. `pinhole_error_px`
    is by how much this camera is wrong anywhere in the sub-image, at the layout's depths: 0 for a flat first-surface
    mirror; second-surface mirrors and bent ones are not pinholes.
    """

    name: str
    row: int
    column: int
    flip: Flip
    camera: Camera
    camera_from_rig: FloatArray
    outline_px: FloatArray
    pinhole_error_px: float

    @cached_property
    def sub_image(self) -> Rectangle:
        """The pixels of the flipped frame that the mirror's bounding rectangle holds."""
        size = np.array([self.camera.width_px, self.camera.height_px])
        first = np.maximum(np.ceil(self.outline_px.min(axis=0)), 0).astype(int)
        last = np.minimum(np.floor(self.outline_px.max(axis=0)), size - 1).astype(int)
        width, height = (int(side) for side in last - first + 1)
        if width < 1 or height < 1:
            raise InputError(f"{self.name} shows no pixel of the sensor, expected a mirror inside the image")
        return Rectangle(int(first[0]), int(first[1]), width, height)

    @cached_property
    def cropped(self) -> Camera:
        """The camera of the flipped frame cut to `sub_image`."""
        return self.cut_to_sub_image(self.camera)

    def cut_to_sub_image(self, camera: Camera) -> Camera:
        """A camera of the flipped frame, as one of the frame cut to `sub_image`."""
        cut = self.sub_image
        return camera.replaced(
            width_px=cut.width, height_px=cut.height, cx_px=camera.cx_px - cut.x, cy_px=camera.cy_px - cut.y
        )

    @cached_property
    def mask(self) -> NDArray[np.uint8]:
        """255 where the centre of a pixel of the flipped frame (h, w) lies in the mirror, else 0."""
        mask = np.zeros((self.camera.height_px, self.camera.width_px), dtype=np.uint8)
        rows, columns = self.sub_image.slices
        x, y = np.meshgrid(np.arange(columns.start, columns.stop), np.arange(rows.start, rows.stop))
        mask[rows, columns] = np.where(shapely.contains_xy(shapely.Polygon(self.outline_px), x, y), 255, 0)
        return mask

    def flipped(self, frame: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The frame (h, w, ...) that `camera` belongs to."""
        return np.flip(frame, axis=1 if self.flip == "left-right" else 0)

    def project(self, points_in_rig: FloatArray) -> FloatArray:
        """Pixels (..., 2) of the flipped frame at which points (..., 3) in mm appear."""
        return self.camera.project(transform(self.camera_from_rig, points_in_rig))


def view_name(row: int, column: int) -> str:
    """Name of the camera of a mirror."""
    return f"view_{row}_{column}"


def virtual_cameras(layout: Layout) -> tuple[VirtualCamera, ...]:
    """All mirrors of a layout as cameras, row by row; those that are no pinholes as the nearest (`exports.nearest`).

    Raises InputError where a mirror shows nothing, or more than the lens model describes.
    """
    flip = upright_flip(layout)
    axes = flip_axes(flip)
    views = []
    for number, mirror in enumerate(layout.mirrors):
        row, column = divmod(number, layout.cols)
        name = view_name(row, column)
        corners = mirror.usable_normalized
        if not len(corners):
            raise InputError(f"{name} shows nothing: light that enters its plate does not leave it")
        along = np.linspace(0.0, 1.0, POINTS_PER_EDGE, endpoint=False)[:, None]
        edges = corners[:, None] * (1.0 - along) + np.roll(corners, -1, axis=0)[:, None] * along
        outline = layout.camera.pixels_from_normalized(edges.reshape(-1, 2))
        if np.isnan(outline).any():
            raise InputError(f"{name} reaches beyond where the lens model is defined")
        try:
            pinhole = nearest_pinhole(layout, number, outline)
            camera = flipped_camera(pinhole.camera, flip)
        except InvalidValue as error:
            raise InputError(f"{name}: {error}") from None
        except InputError as error:
            raise InputError(f"{name} {error}") from None
        camera_from_rig = rigid(
            axes @ pinhole.turn @ mirror.apparent.reflection,
            axes @ (pinhole.turn @ mirror.apparent.virtual_centre_in_rig_mm + pinhole.shift_mm),
        )
        views.append(
            VirtualCamera(
                name=name,
                row=row,
                column=column,
                flip=flip,
                camera=camera,
                camera_from_rig=camera_from_rig,
                outline_px=flipped_pixels(outline, layout.camera, flip),
                pinhole_error_px=pinhole.error_px,
            )
        )
    return tuple(views)


def flip_axes(flip: Flip) -> FloatArray:
    """F (3, 3): what exchanging left and right, or top and bottom, does to the camera's axes."""
    return np.diag([-1.0, 1.0, 1.0] if flip == "left-right" else [1.0, -1.0, 1.0])


def upright_flip(layout: Layout) -> Flip:
    """The flip whose cameras turn the least from the layout's view axes, summed over the mirrors."""
    reflections = np.sum([mirror.apparent.reflection for mirror in layout.mirrors], axis=0)
    turned = reflections @ layout.view_from_rig.T
    # trace(F S V^T) = 1 + 2 cos of the angle between the two rotations.
    return (
        "left-right"
        if np.trace(flip_axes("left-right") @ turned) > np.trace(flip_axes("top-bottom") @ turned)
        else "top-bottom"
    )


def flipped_camera(camera: Camera, flip: Flip) -> Camera:
    """The camera whose frames are another's, flipped."""
    if flip == "left-right":
        return camera.replaced(cx_px=camera.width_px - 1 - camera.cx_px, distortion=camera.lens.flipped(0).coefficients)
    return camera.replaced(cy_px=camera.height_px - 1 - camera.cy_px, distortion=camera.lens.flipped(1).coefficients)


def flipped_pixels(pixels: FloatArray, camera: Camera, flip: Flip) -> FloatArray:
    """Pixels (..., 2) of the camera's frame as those of the flipped frame; its own inverse."""
    if flip == "left-right":
        return np.stack([camera.width_px - 1 - pixels[..., 0], pixels[..., 1]], axis=-1)
    return np.stack([pixels[..., 0], camera.height_px - 1 - pixels[..., 1]], axis=-1)
