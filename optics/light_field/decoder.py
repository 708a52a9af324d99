"""Decoding by one table lookup: undistort, slice and rotate every sub-image into the common view orientation at once.
Lenses with lateral colour have a table for each colour.

Towards the border of a sub-image, a mirror fills less and less of the lens's pupil; the rest of the pupil sees the gap,
assumed dark, or another mirror. A vignetted pixel looks from the centroid of the part that its mirror fills, and
known factors compensate its darkening.
"""

from __future__ import annotations

from copy import copy
from statistics import harmonic_mean
from typing import Any, Literal, Self, get_args

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from mirrorcam.core.arguments import check_choice, check_count, check_number, check_type
from mirrorcam.core.bounds import Bounds
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout, working_distance_mm
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.pupil import HalfPlanes, Pupil, clear_aperture, disc_part
from mirrorcam.optics.geometry.sub_images import unvignetted_outline
from mirrorcam.optics.light_field.equalisation import LINEAR, Equalisation
from mirrorcam.optics.light_field.light_field import LightField, Samples, Views

Field = Literal["common", "union"]
# A decoded pixel blends sensor pixels up to sqrt(2) px away, each of which gathers light from half a pixel around its
# centre: two pixels inside the outline, a pinhole camera receives no light from beyond the mirror's edge. With a lens,
# the pupil blurs that edge, and the part of the pupil that sees the mirror is computed for each pixel.
OUTLINE_MARGIN_PX = 2.0
UNVIGNETTED = 1.0 - 1.0 / 512.0
"""Fraction of the pupil above which an 8-bit sample needs no brightening."""
DEFAULT_REFERENCE_DEPTH_MM = 400.0
DEFAULT_DEPTH_FACTOR = 1.02
"""Minimum default reference depth, relative to the depth of the farthest point of any mirror."""
# cv2.remap accepts no table or image side of 2**15 - 1 px or more.
MAX_TABLE_SIDE = 2**15 - 2
WIDTH_PX = Bounds(2, MAX_TABLE_SIDE)
OUTSIDE_PX = -2.0
MIN_PUPIL_FRACTION = 1.0 / 3.0
"""Fraction of the pupil below which a pixel is left out: brightening it would amplify noise too much."""
MAX_CROSSTALK = 0.01
"""Maximum fraction of the pupil that may see another mirror."""
POINTS_PER_BATCH = 2**16


class Decoder:
    """Decodes frames of one layout into light fields; the lookup table is built once, on construction.

    Without `regular_grid_at_mm`, views keep their true positions: sub-images are rotated, not shifted (as in the 2016
    report), so the table does not depend on depth. For second-surface and bent mirrors, the reference plane is exact;
    at other depths, each view is approximated by the mirror's `apparent` plane, as seen at the centre of its outline.

    Parameters
    ----------
    layout
        Nominal, as-built or calibrated layout.
    reference_depth_mm
        Depth of zero disparity, from the pupil along view z; by default `default_reference_depth_mm`.
    field
        Which part of the reference plane the views cover: `common`, the bounding box of the part that all views see;
        `union`, the bounding box of the part that at least one view sees.
    width_px
        Width of every view; the height follows from the field. Default: the resolution of the sub-images, above which
        views gain no detail and below which they lose some.
    margin_px
        Minimum distance of a valid pixel from its mirror's outline on the sensor, for a pinhole camera; with a lens,
        from the border inside which its mirror fills enough of the pupil.
    regular_grid_at_mm
        Depth at which views are moved to the nearest regular grid (`Views.on_regular_grid`). Points at that depth are
        exact; at others, a view is off by its shift times the difference between the metric slopes.

    Attributes
    ----------
    views : Views
        Geometry of the light fields: positions in mm, focal length and principal point in px.
    weights : ndarray of float32
        (t, s, v, u), 0 where a view has no sample, else the fraction of the camera's pupil that its mirror fills.

    Raises
    ------
    InputError
        If the layout has no mirrors, a mirror shows nothing, the views have no common field, the reference plane is
        nearer than a mirror, or an argument is out of range.
    """

    def __init__(
        self,
        layout: Layout,
        *,
        reference_depth_mm: float | None = None,
        field: Field = "common",
        width_px: int | None = None,
        margin_px: float = OUTLINE_MARGIN_PX,
        regular_grid_at_mm: float | None = None,
    ) -> None:
        check_type("layout", layout, Layout)
        if not layout.mirrors:
            raise InputError("layout: a bare camera, expected one or more mirrors")
        check_choice("field", field, *get_args(Field))
        if width_px is not None:
            check_count("width_px", width_px, WIDTH_PX)
        depths_mm = {"reference_depth_mm": reference_depth_mm, "regular_grid_at_mm": regular_grid_at_mm}
        for name, number in {"margin_px": margin_px, **depths_mm}.items():
            if number is not None:
                check_number(name, number)
                if not np.isfinite(number):
                    raise InputError(f"{name}: {number}, expected a finite number")
        depth = default_reference_depth_mm(layout) if reference_depth_mm is None else reference_depth_mm
        self.camera = layout.camera
        self.views = choose_views(layout, depth, field, width_px)
        if regular_grid_at_mm is not None:
            for index in range(len(layout.mirrors)):
                footprint(layout, index, regular_grid_at_mm)  # raises InputError for a plane that a mirror cannot see
            self.views = self.views.on_regular_grid()
        self.equalisation: Equalisation | None = None
        pixels, self.weights = sensor_sources(layout, self.views, margin_px, regular_grid_at_mm)
        self.weights.flags.writeable = False
        self._vignetted = np.flatnonzero((self.weights > 0.0) & (self.weights < UNVIGNETTED))
        self._gain = self._brightening(LINEAR)
        self.tables = self._tables_of(pixels)
        self.colour_tables = (
            None if self.camera.lateral_colour is None else [*map(self._tables_of, self.camera.colour_pixels(pixels))]
        )

    def _tables_of(self, pixels: FloatArray) -> list[Any]:
        """Return the lookup tables of sensor positions (t, s, v, u, 2), in blocks that cv2.remap accepts."""
        table = pixels.astype(np.float32).reshape(-1, self.views.width_px, 2)
        table[self.weights.reshape(table.shape[:2]) == 0] = OUTSIDE_PX
        rows_per_block = MAX_TABLE_SIDE // self.views.height_px * self.views.height_px
        blocks = [table[start : start + rows_per_block] for start in range(0, len(table), rows_per_block)]
        return [cv2.convertMaps(block, np.empty(0, dtype=np.float32), cv2.CV_16SC2) for block in blocks]

    def equalised(self, equalisation: Equalisation) -> Self:
        """Return a decoder that also makes the views equally bright, up to their borders.

        Without it, the camera is assumed linear. Raises InputError for an equalisation of another layout.
        """
        equalisation.check_belongs_to(self.views)
        decoder = copy(self)
        decoder.equalisation = equalisation
        decoder._gain = self._brightening(equalisation.exponent)
        return decoder

    def _brightening(self, exponent: float) -> dict[int, NDArray[np.float32]]:
        """Return the factors (n, channels) of the vignetted pixels, keyed by the number of channels.

        `exponent` is the exponent of grey levels over light.
        """
        gain = self.weights.ravel()[self._vignetted, None] ** np.float32(-exponent)
        return {channels: np.repeat(gain, channels, axis=1) for channels in (1, 3)}

    def decode(self, frame: Samples) -> LightField:
        """Decode one frame.

        Parameters
        ----------
        frame
            (h, w, 3) in RGB or (h, w) in grey, of the size of the layout's camera: uint8, or float32 from 0 to 1.

        Returns
        -------
        LightField
            Samples (t, s, v, u, c) with the frame's dtype, weights, and the geometry of the views.

        Raises
        ------
        InputError
            If the frame does not match the layout's camera, or has other values.
        """
        check_type("frame", frame, np.ndarray)
        width, height = self.camera.width_px, self.camera.height_px
        if frame.ndim not in (2, 3) or (frame.ndim == 3 and frame.shape[2] not in (1, 3)):
            raise InputError(f"frame has shape {frame.shape}, expected ({height}, {width}, 3) or ({height}, {width})")
        if frame.shape[:2] != (height, width):
            raise InputError(
                f"frame is {frame.shape[1]}x{frame.shape[0]} px, expected {width}x{height} of the layout's camera "
                f"({self.camera.name})"
            )
        if frame.dtype not in (np.uint8, np.float32):
            raise InputError(f"frame is {frame.dtype}, expected uint8, or float32 from 0 to 1")
        if frame.dtype == np.float32:
            # The comparisons are false for NaN.
            low, high = frame.min(), frame.max()
            if not (low >= 0.0 and high <= 1.0):
                raise InputError(f"frame has values from {low:g} to {high:g}, expected float32 from 0 to 1, or uint8")
        if self.colour_tables is None or frame.shape[2:] != (3,):
            samples = _looked_up(frame, self.tables)
        else:  # a table for each colour
            planes = zip(cv2.split(frame), self.colour_tables, strict=True)
            samples = cv2.merge([_looked_up(plane, tables) for plane, tables in planes])
        samples = samples.reshape(*self.weights.shape, -1)
        if len(self._vignetted):
            self._brighten(samples)
        if self.equalisation is not None:
            self.equalisation.apply(samples)
        return LightField.of(self.views, samples, self.weights)

    def _brighten(self, samples: Samples) -> None:
        """Brighten the vignetted pixels in place."""
        channels = samples.shape[-1]
        # Pixels are gathered and scattered as single items, which is several times faster than by channel.
        pixels = samples.reshape(-1).view(f"V{channels * samples.itemsize}")
        dark = pixels.take(self._vignetted).view(samples.dtype).reshape(-1, channels)
        depth = cv2.CV_8U if samples.dtype == np.uint8 else cv2.CV_32F
        bright: Any = cv2.multiply(dark, self._gain[channels], dtype=depth)
        pixels[self._vignetted] = bright.reshape(-1).view(pixels.dtype)


def _looked_up(frame: Any, tables: list[Any]) -> Any:
    """Look up samples (rows, width[, 3]) of a frame (h, w[, 3]) by tables in blocks of rows."""
    parts = [cv2.remap(frame, coordinates, fraction, cv2.INTER_LINEAR) for coordinates, fraction in tables]
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def check_belongs(layout: Layout, identity: str, source: str) -> None:
    """Raise InputError unless `identity` is that of this layout or of the design that it was calibrated or drawn from.

    `source` names the frames in the error, such as "video.mp4"; `identity` is the layout's recorded with them.
    """
    origins = (layout.provenance.get(key) for key in ("nominal", "drawn_from"))
    accepted = [layout.identity, *(origin for origin in origins if origin is not None)]
    if identity not in accepted:
        raise InputError(
            f"{source} was taken with layout {identity}, expected {' or '.join(accepted)} of the given layout"
        )


def default_reference_depth_mm(layout: Layout) -> float:
    """Return the harmonic mean of the design's depths (midway in disparity), or else the depth at the working distance.

    The latter is the median over the views of the depth that they see at the working distance, but beyond all mirrors.
    """
    if layout.spec is not None:
        return harmonic_mean(layout.spec.depths_mm)
    distance_mm = working_distance_mm(layout)
    if distance_mm is None:
        return DEFAULT_REFERENCE_DEPTH_MM
    depths_mm, min_depth_mm = [], 0.0
    for number in range(len(layout.mirrors)):
        centre, mirror_region, _ = _visible_window(layout, number)
        ray = mirror_region.mean(axis=0) - centre
        depths_mm.append(float(centre[2] + distance_mm * ray[2] / np.linalg.norm(ray)))
        min_depth_mm = max(min_depth_mm, DEFAULT_DEPTH_FACTOR * float(mirror_region[:, 2].max()))
    return max(float(np.median(depths_mm)), min_depth_mm)


def footprint(layout: Layout, mirror_index: int, depth_mm: float) -> tuple[Polygon, float]:
    """Return the region of the plane at `depth_mm` that a mirror shows, and its area on the sensor in px^2.

    The polygon is in view axes, (x, y) in mm from the pupil, clipped to the sensor.
    """
    name = f"mirror {layout.mirror_names[mirror_index]}"
    centre, mirror_region, area_px2 = _visible_window(layout, mirror_index)
    rays = mirror_region - centre
    if (rays[:, 2] <= 0).any():
        raise InputError(f"{name} does not look forward along the view axis")
    if (mirror_region[:, 2] >= depth_mm).any():
        nearest = mirror_region[:, 2].max()
        raise InputError(f"the plane at {depth_mm:g} mm lies nearer than {name}, expected more than {nearest:.0f} mm")
    points = centre + rays * ((depth_mm - centre[2]) / rays[:, 2:])
    return Polygon(points[:, :2]), area_px2


def _visible_window(layout: Layout, mirror_index: int) -> tuple[FloatArray, FloatArray, float]:
    """Return a view's centre (3,), the corners (n, 3) of the mirror region that the sensor sees, and its area in px^2.

    Points are in view axes, in mm from the pupil.
    """
    mirror, camera = layout.mirrors[mirror_index].apparent, layout.camera
    usable_outline = layout.mirrors[mirror_index].usable_normalized
    name = f"mirror {layout.mirror_names[mirror_index]}"
    if len(usable_outline) < 3:
        raise InputError(f"{name} shows nothing: its plate is too thick for its size")
    right, bottom = camera.width_px - 1.0, camera.height_px - 1.0
    fractions = np.linspace(0.0, 1.0, 33)[:-1, None]
    corners = np.array([[0.0, 0.0], [right, 0.0], [right, bottom], [0.0, bottom]])
    border = (corners[:, None] * (1.0 - fractions) + np.roll(corners, -1, axis=0)[:, None] * fractions).reshape(-1, 2)
    border = camera.normalized_from_pixels(border)
    sensor = shapely.MultiPoint(border[np.isfinite(border).all(axis=1)]).convex_hull
    visible = shapely.get_coordinates(sensor.intersection(Polygon(usable_outline)))[:-1]
    if len(visible) < 3:
        raise InputError(f"{name} lies outside the image, but all mirrors must be in view")
    mirror_region = mirror.intersect(visible) @ layout.view_from_rig.T
    centre = mirror.virtual_centre_in_rig_mm @ layout.view_from_rig.T
    pixels = camera.pixels_from_normalized(visible)
    return centre, mirror_region, float(Polygon(pixels[np.isfinite(pixels).all(axis=1)]).area)


def choose_views(layout: Layout, reference_depth_mm: float, field: Field, width_px: int | None = None) -> Views:
    """Choose the views' pixel grid over the field, `width_px` wide or at the sub-images' median resolution."""
    indices = range(len(layout.mirrors))
    footprints, areas_px2 = zip(*(footprint(layout, index, reference_depth_mm) for index in indices), strict=True)
    field_region = shapely.intersection_all(footprints) if field == "common" else shapely.union_all(footprints)
    if field_region.area == 0:
        raise InputError(
            f"the views have no common field at depth {reference_depth_mm:g} mm, expected another reference depth"
        )
    left, top, right, bottom = field_region.bounds
    scales = [np.sqrt(area_px2 / region.area) for area_px2, region in zip(areas_px2, footprints, strict=True)]
    px_per_mm = float(np.median(scales))
    if width_px is not None:
        px_per_mm = (width_px - 0.5) / (right - left)
    width, height = (1 + int((end - start) * px_per_mm) for start, end in ((left, right), (top, bottom)))
    if width * height > layout.camera.width_px * layout.camera.height_px or max(width, height) > MAX_TABLE_SIDE:
        raise InputError(f"the {field} field would need {width}x{height} px per view, more than the whole sensor")
    centres = layout.virtual_centres_in_view_mm
    reference = centres.reshape(-1, 3)[layout.central_index]
    field_centre = np.array([(left + right) / 2, (top + bottom) / 2]) - reference[:2]
    views = Views(
        positions_mm=centres - reference,
        focal_px=px_per_mm * float(reference_depth_mm - reference[2]),
        centre_px=(np.array([width, height]) - 1.0) / 2.0 - px_per_mm * field_centre,
        width_px=width,
        height_px=height,
        reference_depth_mm=reference_depth_mm,
        reference_view_in_rig_mm=layout.virtual_centres_in_rig_mm[layout.central_index],
        view_from_rig=layout.view_from_rig,
        layout_identity=layout.identity,
    )
    _, spacings_mm = layout.arrangement.fitted(centres.reshape(-1, 3))
    for axis, size, spacing_mm in zip("st", layout.arrangement.extent, spacings_mm, strict=True):
        if size > 0 and spacing_mm <= 0:
            raise InputError(f"the mirrors' order along {axis} is reversed: s must run right and t down")
    return views


def sensor_sources(
    layout: Layout, views: Views, margin_px: float, regular_grid_at_mm: float | None = None
) -> tuple[FloatArray, NDArray[np.float32]]:
    """Return the sensor positions (t, s, v, u, 2) that decoded pixels sample, and their weights (t, s, v, u).

    A pixel samples the sensor where its mirror (through the plate, if second-surface) shows the pixel's point of the
    reference plane, or of the plane at `regular_grid_at_mm`. With a lens, see `pupil_sources`.
    """
    depth_mm = views.reference_depth_mm if regular_grid_at_mm is None else regular_grid_at_mm
    shape = (len(layout.mirrors), views.height_px, views.width_px)
    pixels, weights = np.empty((*shape, 2)), np.zeros(shape, dtype=np.float32)
    limits = np.array([layout.camera.width_px - 1.0, layout.camera.height_px - 1.0])
    grid = views.pixel_grid()
    for index, (t, s) in enumerate(np.ndindex(views.rows, views.cols)):
        plane = views.plane_points_in_rig(depth_mm, grid, (t, s))
        if layout.camera.aperture_mm > 0.0:
            pixels[index], weights[index] = pupil_sources(layout, index, plane, margin_px)
            continue
        pixels[index] = layout.project(plane, index)
        outline = layout.outline_px(index, points_per_edge=64, usable=True)
        valid_region = Polygon(outline[np.isfinite(outline).all(axis=1)]).buffer(-margin_px)
        if valid_region.is_empty:
            continue
        top_left, bottom_right = np.array(valid_region.bounds).reshape(2, 2)
        top_left, bottom_right = np.maximum(top_left, 0.0), np.minimum(bottom_right, limits)
        candidates = ((pixels[index] >= top_left) & (pixels[index] <= bottom_right)).all(axis=-1)
        shapely.prepare(valid_region)
        weights[index][candidates] = shapely.contains_xy(valid_region, pixels[index][candidates])
    out = (views.rows, views.cols, views.height_px, views.width_px)
    return pixels.reshape(*out, 2), weights.reshape(out)


def pupil_sources(
    layout: Layout, mirror_index: int, points_in_rig: FloatArray, margin_px: float
) -> tuple[FloatArray, NDArray[np.float32]]:
    """Return the sensor positions (..., 2) of points (..., 3) in the rig frame, mm, that a mirror shows, and the
    fractions (...) of the pupil that the mirror fills.

    The fraction is 0 for points that are left out: those where the mirror fills less than `MIN_PUPIL_FRACTION` within
    `margin_px`, or another mirror more than `MAX_CROSSTALK`.
    """
    points = points_in_rig.reshape(-1, 3)
    parts = [
        _pupil_sources(layout, mirror_index, points[start : start + POINTS_PER_BATCH], margin_px)
        for start in range(0, len(points), POINTS_PER_BATCH)
    ]
    pixels, fractions = (np.concatenate(parts) for parts in zip(*parts, strict=True))
    shape = points_in_rig.shape[:-1]
    return pixels.reshape(*shape, 2), fractions.reshape(shape)


def _pupil_sources(
    layout: Layout, mirror_index: int, points: FloatArray, margin_px: float
) -> tuple[FloatArray, NDArray[np.float32]]:
    """Like `pupil_sources`, for points (n, 3)."""
    mirror, camera = layout.mirrors[mirror_index], layout.camera
    image = mirror.image_of(points)
    axial = np.where(image[:, 2:] > 0.0, image[:, 2:], np.nan)
    normalized = camera.chief_rays(image)
    pupil, fraction = camera.pupil, np.zeros(len(points))
    unvignetted = Polygon(unvignetted_outline(mirror, pupil)).buffer(-2.0 * margin_px / min(camera.fx_px, camera.fy_px))
    shapely.prepare(unvignetted)
    fraction[shapely.contains_xy(unvignetted, normalized)] = 1.0
    border = np.flatnonzero((fraction == 0.0) & _near(mirror, pupil, normalized))
    normalized[border], fraction[border] = _vignetted(mirror, camera, normalized[border], axial[border], margin_px)
    pixels = camera.pixels_from_normalized(normalized)
    u, v = pixels.T
    fraction[~((u >= 0.0) & (u <= camera.width_px - 1.0) & (v >= 0.0) & (v <= camera.height_px - 1.0))] = 0.0
    for other in (*layout.mirrors[:mirror_index], *layout.mirrors[mirror_index + 1 :]):
        candidates = np.flatnonzero(fraction)
        candidates = candidates[_near(other, pupil, normalized[candidates])]
        crosstalk = disc_part(clear_aperture(other, normalized[candidates], pupil.focus_mm), pupil.radius_mm).fraction
        fraction[candidates[crosstalk > MAX_CROSSTALK]] = 0.0
    return pixels, fraction.astype(np.float32)


def _vignetted(
    mirror: Mirror, camera: Camera, chief: FloatArray, axial_mm: FloatArray, margin_px: float
) -> tuple[FloatArray, FloatArray]:
    """Return the normalized positions (n, 2) at which vignetted points appear, and the fractions (n,) of the pupil.

    `chief` holds the points' chief rays (n, 2), `axial_mm` (n, 1) their distances along the axis. An image out of focus
    shifts with the centroid of the part of the pupil that sees it.
    """
    pupil = camera.pupil
    centroid = disc_part(clear_aperture(mirror, chief, pupil.focus_mm), pupil.radius_mm).centroid
    normalized = chief - pupil.radius_mm * centroid * (1.0 / axial_mm - 1.0 / pupil.focus_mm)
    planes = clear_aperture(mirror, normalized, pupil.focus_mm)
    fraction = disc_part(planes, pupil.radius_mm).fraction
    margin_mm = margin_px * _mm_per_px(mirror, camera, normalized)
    shrunk = HalfPlanes(planes.direction, planes.distance - margin_mm)
    fraction_within_margin = disc_part(shrunk, pupil.radius_mm).fraction
    return normalized, np.where(fraction_within_margin >= MIN_PUPIL_FRACTION, fraction, 0.0)


def _mm_per_px(mirror: Mirror, camera: Camera, normalized: FloatArray) -> FloatArray:
    """Return by how much the half-planes (n, m) of edges move in the pupil, in mm per px normal to the edge's image.

    They are 0 where the ray points away from the mirror.
    """
    distance, distance_right, distance_below = (
        clear_aperture(mirror, normalized + step, camera.focus_mm).distance
        for step in ((0.0, 0.0), (1.0 / camera.fx_px, 0.0), (0.0, 1.0 / camera.fy_px))
    )
    valid = np.isfinite(distance) & np.isfinite(distance_right) & np.isfinite(distance_below)
    d_u, d_v = (
        np.subtract(shifted, distance, out=np.zeros_like(distance), where=valid)
        for shifted in (distance_right, distance_below)
    )
    return np.hypot(d_u, d_v)


def _near(mirror: Mirror, pupil: Pupil, normalized: FloatArray) -> NDArray[np.bool_]:
    """Return the mask of chief rays (n, 2) so close to a mirror's outline that it may fill part of the pupil."""
    corners = mirror.outline_in_rig_mm + mirror.front_mm * mirror.normal_in_rig
    outline = corners[:, :2] / corners[:, 2:]
    blur = pupil.radius_mm * np.abs(1.0 / corners[:, 2] - 1.0 / pupil.focus_mm).max()
    (left, top), (right, bottom) = outline.min(axis=0) - blur, outline.max(axis=0) + blur
    x, y = normalized.T
    return np.asarray((x >= left) & (x <= right) & (y >= top) & (y <= bottom))
