"""Constraints on mirrors, regions and grids, and the objectives, as smooth terms in CasADi.

Coordinates are in view axes, lengths in units of the design scale. The module `separation` keeps mirrors apart;
`optics.design.assess.depth_sigma` derives the depth objective.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise
from math import prod

import casadi as ca
import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.design.program.mirror_variables import (
    Kind,
    MirrorVariables,
    Optics,
    add_mirror,
    cross_2d,
    edges_of,
    mirror_of,
    pixels,
    polygon_area,
    reflected,
    subdivided,
    view_from_rig,
)
from mirrorcam.optics.design.program.terms import Expression, Term, TermBuilder
from mirrorcam.optics.geometry.arrangement import Arrangement

MARGIN = 1e-6
"""Margin on every limit, in units of the design scale, so that the rounded layout still meets it."""
MIN_CORNER_AREA = 1e-3
"""Minimum area spanned by the two edges at a corner of a sub-image, relative to a tile of the sensor."""
MIN_RAY_COMPONENT = 0.1
"""Minimum scalar product of a corner ray (z = 1) and the virtual centre, in units of the design scale."""
MIN_GRID_SPACING = 0.05
REGION_CORNERS = 8
"""Corners of the region at a depth that all views must show."""
ANGLES = 8
"""Number of directions in which the texture at a point is matched."""


@lru_cache
def mirror_term(kind: Kind) -> Term:
    """One mirror: it can be manufactured, its sub-image lies on the sensor, and it folds light towards the scene.

    Unknowns: fold angle, virtual centre, corners. Parameters: optics, intrinsics, sensor px (2), minimum edge, minimum
    area, nearest depth, area of a tile, reward per tile of sub-image area.
    """
    term = TermBuilder()
    optics, intrinsics, size_px = Optics.of_term(term), term.parameter(kind.intrinsics), term.parameter(2)
    min_edge, min_area, depth, tile_area, reward = (term.parameter() for _ in range(5))
    mirror = add_mirror(kind, optics, term)
    for corner in mirror.corners:
        term.require(ca.dot(optics.view_from_rig @ ca.vertcat(corner, 1.0), mirror.centre) - MIN_RAY_COMPONENT)
    for edge, next_edge in edges_of([b - a for a, b in edges_of(mirror.corners)]):
        term.require(cross_2d(edge, next_edge) / tile_area - MIN_CORNER_AREA)
    for a, b in edges_of(mirror.face):
        term.require(ca.sumsqr(b - a) - min_edge**2 - MARGIN, "size")
    fans = [ca.cross(a - mirror.face[0], b - mirror.face[0]) for a, b in pairwise(mirror.face[1:])]
    term.require(0.5 * sum(ca.dot(fan, mirror.normal) for fan in fans) - min_area - MARGIN, "size")
    for point in mirror.solid:
        term.require(depth - point[2] - MARGIN, "depth")
    if kind.second_surface:
        # The pupil must lie in front of the plate.
        term.require(ca.sqrt(ca.sumsqr(mirror.centre)) / 2.0 - mirror.glass_in_front - MARGIN, "occlusion")
    if kind.distorted:
        # Points along the bent edges stay on the sensor. Without distortion, the limits on corners suffice.
        margin_px = 0.25
        for point in subdivided(mirror.corners, 8):
            pixel = pixels(kind.lens_model, intrinsics, point)
            term.require((ca.vertcat(pixel + 0.5, size_px - 0.5 - pixel) - margin_px) / size_px[0])
    term.minimise(-reward * polygon_area(mirror.corners) / tile_area)
    return term.built()


@lru_cache
def rectangle_term(kind: Kind) -> Term:
    """The face of a mirror is a rectangle of a size that may be unknown or given.

    Five equations leave the five degrees of freedom of a rectangle in its plane, or three once its size is given.
    Unknowns: fold angle, virtual centre, corners, size (2) along the first and the second edge. Parameters: optics.
    """
    term = TermBuilder()
    optics = Optics.of_term(term)
    face = add_mirror(kind, optics, term).face
    size = term.unknown(2)
    first, second = face[1] - face[0], face[2] - face[1]
    # Two components suffice, as the corners lie in one plane, which never contains the view axis.
    term.require((first + face[3] - face[2])[:2])
    term.require(ca.dot(first, second))
    term.require(ca.vertcat(ca.sumsqr(first), ca.sumsqr(second)) - size**2)
    return term.built(equality=True)


def region_directions() -> FloatArray:
    """Directions (8, 2) of the corners of a region from its centre, in view axes, on the unit circle.

    They run from +x to +y in a mirror's sub-image.
    """
    angles = 2.0 * np.pi * (np.arange(REGION_CORNERS) + 0.5) / REGION_CORNERS
    return np.column_stack([np.cos(angles), -np.sin(angles)])


@lru_cache
def region_term() -> Term:
    """A star-shaped region with winding number one: each corner stays in its own sector about an unknown centre.

    Unknowns: centre (2), corners (2 each). Parameters: half the initial size (2).
    """
    term = TermBuilder()
    centre, corners, half_size = term.unknown(2), term.unknown(2 * REGION_CORNERS), term.parameter(2)
    directions = region_directions()
    borders = directions + np.roll(directions, -1, axis=0)
    for k in range(REGION_CORNERS):
        corner = (corners[2 * k : 2 * k + 2] - centre) / half_size
        term.require(-cross_2d(ca.DM(borders[k - 1]), corner))
        term.require(cross_2d(ca.DM(borders[k]), corner))
    return term.built()


@lru_cache
def view_term(kind: Kind, tilted: bool = False) -> Term:
    """A mirror shows an entire region, and is rewarded for the fraction of the sensor's pixels that see the region.

    Unknowns: fold angle, virtual centre, corners of the sub-image, and corners of the region as offsets from the aim
    point (straight ahead of the central mirror), divided by 1 + depth, so that their size hardly depends on depth.
    Parameters: optics, intrinsics, sensor px (2), depth, area of a tile, weight of the fraction, minimum fraction, and,
    if `tilted`, the tilt (2) of the mirror as built.

    The tilt moves the image in the mirror, but not its outline, which moves far less.
    """
    term = TermBuilder()
    optics, intrinsics, size_px = Optics.of_term(term), term.parameter(kind.intrinsics), term.parameter(2)
    depth, tile_area, weight, min_fraction = (term.parameter() for _ in range(4))
    rig_from_view, aim = optics.view_from_rig.T, optics.view_from_rig[:2, 2]
    # In the rig frame few operations depend on the fold: this term takes most of the time of a design.
    in_rig, centre = optics.in_rig, rig_from_view @ term.unknown(3)
    mirror = mirror_of(kind, in_rig, centre, term.unknown(2 * kind.sides))
    corners = term.unknown(2 * REGION_CORNERS)
    if tilted:
        centre = mirror.tilted_centre(term.parameter(2))
    images = []
    for k in range(REGION_CORNERS):
        point = rig_from_view @ ca.vertcat(aim + corners[2 * k : 2 * k + 2] * (1.0 + depth), depth)
        image = reflected(point, centre)
        images.append(image[:2] / image[2])
    for a, b in _usable_edges(kind, mirror):
        if kind.pinhole:
            start, end = a[:2] / a[2], b[:2] / b[2]
            clearances = [cross_2d(end - start, image - start) for image in images]
        else:
            clearances = _clearances_of_bundles(mirror, in_rig, a, b, images)
        for clearance in clearances:
            term.require(clearance / tile_area, "overlap")
    if kind.distorted:
        area_px = polygon_area([pixels(kind.lens_model, intrinsics, point) for point in subdivided(images, 3)])
    else:
        area_px = polygon_area(images) * intrinsics[0] * intrinsics[1]
    fraction = area_px / (size_px[0] * size_px[1])
    term.require(fraction - min_fraction)
    term.minimise(-weight * fraction)
    return term.built()


def _usable_edges(kind: Kind, mirror: MirrorVariables) -> list[tuple[Expression, Expression]]:
    """Ends (3) of the edges of the part of the face that shows the scene.

    Edges of a second-surface mirror are inset by `entry`, because light must enter and leave through the front.
    """
    if not kind.second_surface:
        return edges_of(mirror.face)
    inset = []
    for a, b in edges_of(mirror.face):
        inward = ca.cross(mirror.normal, b - a) / ca.sqrt(ca.sumsqr(b - a))
        shift = ca.sqrt(ca.dot(inward, mirror.entry) ** 2 + 1e-10) * inward
        inset.append((a + shift, b + shift))
    return inset


def _clearances_of_bundles(
    mirror: MirrorVariables, optics: Optics, a: Expression, b: Expression, images: list[Expression]
) -> list[Expression]:
    """For each chief ray, at least 0 if its complete ray bundle passes inside an edge; all in the rig frame.

    Chief rays are normalized image points (2). The ray from a point p of the pupil has the clearance
    constant + gradient . p (`geometry.pupil.edge_clearance`).
    """
    distance = ca.sqrt(ca.sumsqr(mirror.centre)) / 2.0
    inward = ca.cross(mirror.normal, b - a)
    offset = ca.dot(inward, a)
    clearances = []
    for image in images:
        ray = ca.vertcat(image, 1.0)
        normal_part, inward_part = ca.dot(mirror.normal, ray), ca.dot(inward, ray)
        constant = distance * inward_part - normal_part * offset
        gradient = (normal_part - distance * optics.inverse_focus) * inward
        gradient -= (inward_part - optics.inverse_focus * offset) * mirror.normal
        clearances.append(constant - optics.radius * optics.in_pupil_plane(gradient))
    return clearances


def squared_grid_error(centres: list[Expression], arrangement: Arrangement) -> tuple[Expression, list[Expression]]:
    """Squared grid error of virtual centres (view axes) from the best-fitting grid or pattern, and its spacings.

    The fit is a linear regression on the steps; the error is relative to the geometric mean of the spacings.
    """
    steps_x, steps_y = arrangement.steps.T
    mean: Expression = sum(centres, start=ca.SX.zeros(3)) / len(centres)
    residual = ca.horzcat(*(centre - mean for centre in centres)).T
    spacings = []
    for axis, steps in ((0, steps_x), (1, steps_y)):
        if steps.any():
            spacing = ca.dot(residual[:, axis], ca.DM(steps)) / float(steps @ steps)
            residual[:, axis] -= spacing * ca.DM(steps)
            spacings.append(spacing)
    return ca.sumsqr(residual) / len(centres) / prod(spacings) ** (2.0 / len(spacings)), spacings


def add_grid_error(term: TermBuilder, arrangement: Arrangement) -> Expression:
    """Add virtual centres to a term's unknowns, require positive spacings, and return their squared grid error."""
    error, spacings = squared_grid_error([term.unknown(3) for _ in arrangement.names], arrangement)
    for spacing in spacings:
        term.require(spacing - MIN_GRID_SPACING)
    return error


@lru_cache
def grid_term(arrangement: Arrangement) -> Term:
    """Virtual centres near a grid or pattern with positive spacings. Parameter: weight of the squared grid error."""
    term = TermBuilder()
    term.minimise(term.parameter() * add_grid_error(term, arrangement))
    return term.built()


@lru_cache
def mean_term(count: int) -> Term:
    """The mean of `count` virtual centres equals the centre of a mirror that folds the optical axis at unit scale.

    Unknowns: fold angle, virtual centres.
    """
    term = TermBuilder()
    axis = view_from_rig(term.unknown(1))[:, 2]
    centres = [term.unknown(3) for _ in range(count)]
    term.require(sum(centres[1:], start=centres[0]) / count - axis + ca.DM([0.0, 0.0, 1.0]))
    return term.built(equality=True)


def depth_information(
    centres: list[Expression],
    central: int,
    fold: Expression,
    point: Expression,
    inverse_focus: Expression,
    blur: Expression,
) -> Expression:
    """Fisher information of a window of the central view about the depth of a point (3), up to a factor.

    Views (3) and point are in view axes, in units of the design scale. The bound assumes a texture with equal gradient
    at each frequency. A
    view with the Jacobian J, px per length, has the weight |J| / (s |J^-T u|)^2 in the direction u. s^2 is the variance
    of its blur relative to a sharp picture, 1 + (blur (1 / z - inverse_focus))^2.
    """
    rotation = view_from_rig(fold)
    density, parallax, inverses, variances = [], [], [], []
    for centre in centres:
        image = rotation.T @ reflected(point, centre)
        d_image = rotation.T @ (ca.DM.eye(3) - 2.0 * centre @ centre.T / ca.sumsqr(centre))[:, :2]
        z = image[2]
        jacobian = (d_image[:2, :] * z - image[:2] @ d_image[2, :]) / z**2
        area = jacobian[0, 0] * jacobian[1, 1] - jacobian[0, 1] * jacobian[1, 0]
        adjoint = ca.blockcat([[jacobian[1, 1], -jacobian[1, 0]], [-jacobian[0, 1], jacobian[0, 0]]])
        density.append(ca.sqrt(area**2))
        inverses.append(adjoint / area)
        variances.append(1.0 + (blur * (1.0 / z - inverse_focus)) ** 2)
        parallax.append((point[:2] - centre[:2]) / (point[2] - centre[2]))
    information: Expression = ca.SX(0.0)
    for angle in np.pi * (np.arange(ANGLES) + 0.5) / ANGLES:
        direction = ca.DM([np.cos(angle), np.sin(angle)])
        weights = [n / (v * ca.sumsqr(i @ direction)) for n, v, i in zip(density, variances, inverses, strict=True)]
        components = [ca.dot(view_parallax, direction) for view_parallax in parallax]
        mean = sum(w * m for w, m in zip(weights, components, strict=True)) / sum(weights)
        information += sum(w * (m - mean) ** 2 for w, m in zip(weights, components, strict=True))
    return information / density[central]


@lru_cache
def depth_sigma_term(count: int, central: int) -> Term:
    """The standard deviation of depth at a point, up to a factor.

    Unknowns: fold angle, virtual centres. Parameters: depth, the point (2) relative to the aim point as for corners in
    `view_term`, 1 / focus, `blur`, weight.
    """
    term = TermBuilder()
    fold, centres = term.unknown(1), [term.unknown(3) for _ in range(count)]
    depth, tangents = term.parameter(), term.parameter(2)
    inverse_focus, blur, weight = (term.parameter() for _ in range(3))
    point = ca.vertcat(view_from_rig(fold)[:2, 2] + tangents * (1.0 + depth), depth)
    term.minimise(weight / ca.sqrt(depth_information(centres, central, fold, point, inverse_focus, blur)))
    return term.built()


def field_of_view(corners: Expression, centres: list[Expression], depth: Expression) -> Expression:
    """Size (2) of a region along x and y, as tangents from the mean virtual centre.

    It is measured between the means of the two corners at each end; `corners` are the unknowns of `region_term`.
    """
    mean_z = sum(centre[2] for centre in centres) / len(centres)
    sides = []
    for axis in range(2):
        component = region_directions()[:, axis]
        right, left = (np.flatnonzero(sign * component > 0.7).tolist() for sign in (1.0, -1.0))
        sides.append(sum(corners[2 * k + axis] for k in right) / 2.0 - sum(corners[2 * k + axis] for k in left) / 2.0)
    return ca.vertcat(*sides) * (1.0 + depth) / (depth - mean_z)


@lru_cache
def field_of_view_term(count: int) -> Term:
    """A region of at least a given size. Unknowns: corners, virtual centres. Parameters: depth, minimum size (2)."""
    term = TermBuilder()
    corners, centres = term.unknown(2 * REGION_CORNERS), [term.unknown(3) for _ in range(count)]
    depth, min_size = term.parameter(), term.parameter(2)
    term.require(field_of_view(corners, centres, depth) - min_size)
    return term.built()


@lru_cache
def grid_limit_term(arrangement: Arrangement) -> Term:
    """Virtual centres near a grid or pattern with positive spacings. Parameter: maximum grid error."""
    term = TermBuilder()
    term.require(term.parameter() ** 2 - add_grid_error(term, arrangement))
    return term.built()
