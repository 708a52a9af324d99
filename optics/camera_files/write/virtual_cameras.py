"""Mirrors as cameras for other tools: a pinhole with a lens, at a rigid pose, with a separate picture.

In a mirror, the base camera sees the mirror image of the view from the virtual centre c. With the mirror's unit normal
n, S = I - 2 n n^T and reflect(x) = S x + c, the base camera projects S x + c, which has the wrong handedness:
det S = -1. Flipping the *frame* corrects it. A left-right flip, F = diag(-1, 1, 1), maps the pixel column u to
W - 1 - u. Since the lens model obeys

    distort(-x, y; k, p1, -p2) = (-x_d, y_d)    where    (x_d, y_d) = distort(x, y; k, p1, p2)

the flipped frame belongs to a camera with cx' = W - 1 - cx and p2' = -p2 that projects F (S x + c). For a top-bottom
flip, F = diag(1, -1, 1), cy' = H - 1 - cy and p1' = -p1. In both cases

    camera_from_rig = [F S | F c],    det F S = +1,    centre = -(F S)^T F c = -S c = c.

Each layout uses the flip that makes its views upright: top-bottom if mirrors above the camera fold its view,
left-right if it looks past mirrors at its side.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray, InvalidValue
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout, working_range_mm
from mirrorcam.optics.geometry.transforms import rigid, transform

Flip = Literal["left-right", "top-bottom", "none"]
BARE = "camera"
"""Name of a camera without mirrors."""
POINTS_PER_EDGE = 16
GRID = 12  # samples along x and y of a sub-image
DISTANCES_MM = (300.0, 1000.0)
"""Range of distances from the virtual centre for layouts without a working range."""
MIN_DISTANCE_RATIO = 1.05
"""Distance of the nearest points, relative to the mirror's distance along the ray."""
STEPS = 8
FREE_NAMES = ("fx_px", "fy_px", "k1", "k2", "p1", "p2")
"""Parameters fitted together with the pose; the principal point correlates with the rotation and stays fixed."""
EXACT_PX = 1e-9


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

    Attributes
    ----------
    name : name of the view.
    row, column : position of the mirror in the layout.
    flip : flip of the frame; none without a mirror.
    camera : intrinsics for the entire flipped frame.
    camera_from_rig : rigid transform (4, 4), mm.
    outline_px : outline (n, 2) of the mirror's image in the flipped frame.
    pinhole_error_px : largest error of this camera in the sub-image, at the layout's depths: 0 for a flat first-surface
        mirror; second-surface and bent mirrors are not exact pinholes.
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
        """Bounding rectangle of the outline in the flipped frame; raises InputError if it has no pixels."""
        size = np.array([self.camera.width_px, self.camera.height_px])
        first = np.maximum(np.ceil(self.outline_px.min(axis=0)), 0).astype(int)
        last = np.minimum(np.floor(self.outline_px.max(axis=0)), size - 1).astype(int)
        width, height = (int(side) for side in last - first + 1)
        if width < 1 or height < 1:
            raise InputError(f"{self.name} shows no pixel of the sensor, expected a mirror inside the image")
        return Rectangle(int(first[0]), int(first[1]), width, height)

    @cached_property
    def cropped(self) -> Camera:
        """The camera for the flipped frame cropped to `sub_image`."""
        return self.crop_to_sub_image(self.camera)

    def crop_to_sub_image(self, camera: Camera) -> Camera:
        """Crop a camera of the flipped frame to `sub_image`."""
        crop = self.sub_image
        return camera.replaced(
            width_px=crop.width, height_px=crop.height, cx_px=camera.cx_px - crop.x, cy_px=camera.cy_px - crop.y
        )

    @cached_property
    def mask(self) -> NDArray[np.uint8]:
        """255 where the centre of a pixel of the flipped frame (h, w) lies inside the outline, else 0."""
        mask = np.zeros((self.camera.height_px, self.camera.width_px), dtype=np.uint8)
        rows, columns = self.sub_image.slices
        x, y = np.meshgrid(np.arange(columns.start, columns.stop), np.arange(rows.start, rows.stop))
        mask[rows, columns] = np.where(shapely.contains_xy(shapely.Polygon(self.outline_px), x, y), 255, 0)
        return mask

    def flipped(self, frame: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Flip a frame (h, w, ...) to match `camera`."""
        if self.flip == "none":
            return frame
        return np.flip(frame, axis=1 if self.flip == "left-right" else 0)

    def project(self, points_in_rig: FloatArray) -> FloatArray:
        """Pixels (..., 2) of the flipped frame at which points (..., 3) in mm appear."""
        return self.camera.project(transform(self.camera_from_rig, points_in_rig))


def view_name(row: int, column: int) -> str:
    """Name of the camera of a mirror."""
    return f"view_{row}_{column}"


def bare_camera(camera: Camera) -> VirtualCamera:
    """A camera without mirrors, which sees the complete frame."""
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * [camera.width_px - 1, camera.height_px - 1]
    return VirtualCamera(BARE, 0, 0, "none", camera, np.eye(4), corners.astype(np.float64), 0.0)


def virtual_cameras(layout: Layout) -> tuple[VirtualCamera, ...]:
    """All mirrors of a layout as cameras, row by row; mirrors that are not pinholes are fitted (`nearest_pinhole`).

    Raises InputError if a mirror shows nothing, or reaches beyond the lens model.
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
        fractions = np.linspace(0.0, 1.0, POINTS_PER_EDGE, endpoint=False)[:, None]
        edges = corners[:, None] * (1.0 - fractions) + np.roll(corners, -1, axis=0)[:, None] * fractions
        outline = layout.camera.pixels_from_normalized(edges.reshape(-1, 2))
        if np.isnan(outline).any():
            raise InputError(f"{name} reaches beyond the range of the lens model")
        try:
            pinhole = nearest_pinhole(layout, number, outline)
            camera = flipped_camera(pinhole.camera, flip)
        except InvalidValue as error:
            raise InputError(f"{name}: {error}") from None
        except InputError as error:
            raise InputError(f"{name} {error}") from None
        camera_from_rig = rigid(
            axes @ pinhole.rotation @ mirror.apparent.reflection,
            axes @ (pinhole.rotation @ mirror.apparent.virtual_centre_in_rig_mm + pinhole.translation_mm),
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
    """F (3, 3): the effect of a flip on the camera's axes."""
    return np.diag([-1.0, 1.0, 1.0] if flip == "left-right" else [1.0, -1.0, 1.0])


def upright_flip(layout: Layout) -> Flip:
    """The flip with the smallest rotation between its cameras and the layout's view axes, over all mirrors."""
    reflections = np.sum([mirror.apparent.reflection for mirror in layout.mirrors], axis=0)
    rotated = reflections @ layout.view_from_rig.T
    # trace(F S V^T) = 1 + 2 cos of the angle between the two rotations.
    return (
        "left-right"
        if np.trace(flip_axes("left-right") @ rotated) > np.trace(flip_axes("top-bottom") @ rotated)
        else "top-bottom"
    )


def flipped_camera(camera: Camera, flip: Flip) -> Camera:
    """The camera for flipped frames of a camera."""
    if flip == "left-right":
        return camera.replaced(cx_px=camera.width_px - 1 - camera.cx_px, distortion=camera.lens.flipped(0).coefficients)
    return camera.replaced(cy_px=camera.height_px - 1 - camera.cy_px, distortion=camera.lens.flipped(1).coefficients)


def flipped_pixels(pixels: FloatArray, camera: Camera, flip: Flip) -> FloatArray:
    """Map pixels (..., 2) of the camera's frame to the flipped frame; its own inverse."""
    if flip == "left-right":
        return np.stack([camera.width_px - 1 - pixels[..., 0], pixels[..., 1]], axis=-1)
    return np.stack([pixels[..., 0], camera.height_px - 1 - pixels[..., 1]], axis=-1)


@dataclass(frozen=True)
class NearestPinhole:
    """A camera that sees the apparent mirror's images X' of points at `rotation` X' + `translation_mm` in its frame.

    `error_px` is the largest distance between a point's exact pixel and this camera's, over the sub-image and the range
    of distances.
    """

    camera: Camera
    rotation: FloatArray
    translation_mm: FloatArray
    error_px: float


@np.errstate(all="ignore")  # overflow ends the fit
def nearest_pinhole(layout: Layout, number: int, outline_px: FloatArray) -> NearestPinhole:
    """Fit a pinhole camera to a mirror within its sub-image with the outline (n, 2), over the layout's working range.

    For a flat first-surface mirror it is the base camera itself, unless that depends on depth. Otherwise Gauss-Newton
    steps from there fit pose, focal lengths and distortion to a grid of points; the result is valid only within this
    sub-image. Steps end when they leave the valid cameras. Raises InputError if the base camera itself cannot see these
    points.
    """
    mirror, apparent = layout.mirrors[number], layout.mirrors[number].apparent
    pixels = np.concatenate([outline_px, _grid(outline_px)])
    rays = layout.camera.unproject(pixels)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    nearest = MIN_DISTANCE_RATIO * np.linalg.norm(apparent.intersect(rays[:, :2] / rays[:, 2:]), axis=-1, keepdims=True)
    near, far = fitted_distances_mm(layout)
    images = np.concatenate([rays * np.maximum(mm, nearest) for mm in (near, 2.0 / (1.0 / near + 1.0 / far), far)])
    exact = layout.camera.project(mirror.image_of(apparent.reflect(images)))
    camera, rotation, translation = layout.camera.in_focus, np.eye(3), np.zeros(3)
    best = NearestPinhole(camera, rotation, translation, _max_error_px(camera, images, exact))
    if best.error_px < EXACT_PX:
        return best
    free = [index for index, name in enumerate(camera.intrinsic_names) if name in FREE_NAMES]
    for _ in range(STEPS):
        points = images @ rotation.T + translation
        projected, d_point, d_intrinsic = camera.project_with_jacobians(points)
        d_rotation = -np.cross(d_point, points[:, None])  # d(w x X)/dw, row by row: r . (w x X) = w . (X x r)
        columns = np.concatenate([d_rotation, d_point, d_intrinsic[:, :, free]], axis=2).reshape(-1, 6 + len(free))
        scale = np.linalg.norm(columns, axis=0)
        if not (np.isfinite(columns / scale).all() and np.isfinite(exact - projected).all()):
            break
        step = np.linalg.lstsq(columns / scale, (exact - projected).ravel(), rcond=1e-9)[0] / scale
        change = Rotation.from_rotvec(step[:3]).as_matrix()
        rotation, translation = change @ rotation, change @ translation + step[3:6]
        intrinsics = camera.intrinsics.copy()
        intrinsics[free] += step[6:]
        try:
            camera = camera.with_intrinsics(intrinsics)
        except InvalidValue:
            break
        error_px = _max_error_px(camera, images @ rotation.T + translation, exact)
        if error_px < best.error_px:
            best = NearestPinhole(camera, rotation, translation, error_px)
    if not np.isfinite(best.error_px):
        raise InputError(
            "shows points where the lens model or the mirror's plate is not defined, expected other points"
        )
    return best


def fitted_distances_mm(layout: Layout) -> tuple[float, float]:
    """Range of distances from the virtual centres over which cameras are fitted."""
    return working_range_mm(layout) or DISTANCES_MM


def _grid(outline_px: FloatArray) -> FloatArray:
    low, high = outline_px.min(axis=0), outline_px.max(axis=0)
    grid = np.stack(np.meshgrid(*np.linspace(low, high, GRID).T), axis=-1).reshape(-1, 2)
    return np.asarray(grid[shapely.contains_xy(shapely.Polygon(outline_px), grid)])


def _max_error_px(camera: Camera, points: FloatArray, pixels: FloatArray) -> float:
    return float(np.linalg.norm(camera.project(points) - pixels, axis=1).max())
