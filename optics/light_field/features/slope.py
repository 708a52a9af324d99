"""The point-plane law of parallel views, linear in the unknowns: the position of a point in all views, and its slope.

With w = 1 / Z the inverse distance of a point from the reference view and a = (X / Z, Y / Z) its direction from there,
the pinhole of a view at p_i = (x_i, y_i), z_i is

    b_i = f_i a + w A_i,    b_i = u_i - c_i,    A_i = z_i b_i - f_i p_i,

in units of (1 - z_i w) pixels: the paper's (u, v) = (D / P_z) (P_x - s, P_y - t) if z_i = 0. A point seen in or through
a curved surface has two slopes, along perpendicular directions (rays stay perpendicular to wavefronts, so the matrix
below is symmetric):

    b_i = f_i a + W A_i,    W = [[w + d, e], [e, w - d]],    slopes w +- sqrt(d^2 + e^2).

Two slopes as a sign of refraction: Tsai, Dansereau, Peynot and Corke, "Distinguishing refracted features using light
field cameras with application to structure from motion", RA-L 2019.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.light_field import Views

# Best accuracy of localisation in 8-bit pictures, however well views agree.
MIN_NOISE_PX = 0.003


@dataclass(frozen=True, eq=False)
class Geometry:
    """Geometry of the views for the slope law, as flat lists (n views): focal lengths, principal points, positions."""

    focal_px: FloatArray
    centre_px: FloatArray
    across_mm: FloatArray
    forward_mm: FloatArray
    reference: int

    @classmethod
    def of(cls, views: Views) -> Geometry:
        matrices, positions = views.matrices.reshape(-1, 3, 3), views.positions_mm.reshape(-1, 3)
        return cls(
            focal_px=matrices[:, 0, 0],
            centre_px=matrices[:, :2, 2],
            across_mm=positions[:, :2],
            forward_mm=positions[:, 2],
            reference=int((positions**2).sum(axis=1).argmin()),
        )

    def directions(self, pixels: FloatArray) -> FloatArray:
        """Directions a (n, 2) of pixels (n, 2) of the reference view."""
        return (pixels - self.centre_px[self.reference]) / self.focal_px[self.reference]

    def predict(self, view: int, directions: FloatArray, inverse_mm: FloatArray | float) -> FloatArray:
        """Pixels (n, 2) in a view of points with directions (n, 2) and inverse distances (n,)."""
        w = np.asarray(inverse_mm, dtype=np.float64)[..., None]
        ahead = 1.0 - self.forward_mm[view] * w
        return self.focal_px[view] * (directions - self.across_mm[view] * w) / ahead + self.centre_px[view]

    def terms(self, view: int, pixels: FloatArray) -> tuple[FloatArray, FloatArray]:
        """A and b (n, 2) of the law for pixels (n, 2) in a view."""
        b = pixels - self.centre_px[view]
        return self.forward_mm[view] * b - self.focal_px[view] * self.across_mm[view], b


@dataclass(frozen=True, eq=False)
class SlopeFit:
    """Least-squares fit of points to the views that see them.

    Attributes
    ----------
    directions
        Directions a (n, 2).
    inverse_mm
        Inverse distances w (n,).
    distances_px
        Distance (views, n) between the observed and the fitted pixel of a point; NaN if not seen.
    information
        Information (n,) on w, mm^2, for noise of one pixel: the variance of w is noise^2 / information.
    squares_px2
        Sum (n,) of squared distances over the views used, weighted by the precision.
    freedom
        Degrees of freedom (n,): measured coordinates minus the three unknowns.
    """

    directions: FloatArray
    inverse_mm: FloatArray
    distances_px: FloatArray
    information: FloatArray
    squares_px2: FloatArray
    freedom: NDArray[np.int64]


def fit_slope(
    geometry: Geometry,
    seen_px: FloatArray,
    used: NDArray[np.bool_],
    about_inverse_mm: FloatArray,
    precision: FloatArray,
) -> SlopeFit:
    """Fit the consolidated slope of points seen at (views, n, 2) in the views `used` (views, n).

    `about_inverse_mm` (n,) need only be approximate: it sets the units of the equations, (1 - z_i w) being close to
    one. `precision` (n, 2, 2) is the relative precision along u and v, with mean one.

    A point used in no view but the reference has information 0 and slope NaN.
    """
    a_, b, focal = _equations(geometry, seen_px, about_inverse_mm)
    cholesky = np.linalg.cholesky(precision).transpose(0, 2, 1)
    a_, b = np.einsum("nij,vnj->vni", cholesky, a_), np.einsum("nij,vnj->vni", cholesky, b)
    use = used.astype(np.float64)
    ff = np.maximum((use * focal**2).sum(axis=0), 1e-12)
    fa = np.einsum("vn,vn,vnk->nk", use, focal, a_)
    fb = np.einsum("vn,vn,vnk->nk", use, focal, b)
    information = np.einsum("vn,vnk,vnk->n", use, a_, a_) - (fa * fa).sum(axis=1) / ff
    w = (np.einsum("vn,vnk,vnk->n", use, a_, b) - (fa * fb).sum(axis=1) / ff) / np.where(
        information > 1e-6 * ff, information, np.nan
    )
    directions = (fb - w[:, None] * fa) / ff[:, None]
    residual = b - focal[..., None] * directions - w[:, None] * a_
    squares = (residual**2).sum(axis=2)
    unweighted = np.linalg.inv(cholesky)
    distances = np.linalg.norm(np.einsum("nij,vnj->vni", unweighted, residual), axis=2)
    return SlopeFit(
        directions=np.einsum("nij,nj->ni", unweighted, directions),
        inverse_mm=w,
        distances_px=np.where(np.isfinite(seen_px[..., 0]), distances, np.nan),
        information=information,
        squares_px2=(use * squares).sum(axis=0),
        freedom=2 * used.sum(axis=0) - 3,
    )


def agreeing_views(
    geometry: Geometry,
    seen_px: FloatArray,
    about_inverse_mm: FloatArray,
    precision: FloatArray,
    max_distance_px: float,
) -> NDArray[np.bool_]:
    """Mask (views, n) of views that see points within `max_distance_px` of where one slope predicts them; `seen_px` may
    be NaN.

    The limit decreases in steps, so that one wrong view affects only the first fit of a point.
    """
    shown = np.isfinite(seen_px[..., 0])
    used = shown.copy()
    for factor in (3.0, 1.5, 1.0, 1.0):
        solved = fit_slope(geometry, seen_px, used, about_inverse_mm, precision)
        used = shown & (solved.distances_px <= factor * max_distance_px)
    return used


@dataclass(frozen=True, eq=False)
class TwoSlopes:
    """Slopes along s and t, estimated separately.

    Attributes
    ----------
    matrices_mm
        Matrices W (n, 2, 2), 1/mm; NaN if the views used do not determine them.
    apart_mm
        The components d and e (n, 2), 1/mm.
    apart_covariance
        Covariance (n, 2, 2) of these for noise of one pixel.
    squares_px2
        Sum (n,) of squared residual distances.
    freedom
        Degrees of freedom (n,): measured coordinates minus the five unknowns.
    """

    matrices_mm: FloatArray
    apart_mm: FloatArray
    apart_covariance: FloatArray
    squares_px2: FloatArray
    freedom: NDArray[np.int64]


def fit_two_slopes(
    geometry: Geometry,
    seen_px: FloatArray,
    used: NDArray[np.bool_],
    about_inverse_mm: FloatArray,
    precision: FloatArray,
) -> TwoSlopes:
    """Fit a symmetric matrix instead of the slope, otherwise like `fit_slope`."""
    a_, b, focal = _equations(geometry, seen_px, about_inverse_mm)
    use = used.astype(np.float64)
    # Columns of the unknowns w, d, e in the two rows of each view, after projecting out a, which is also free.
    x, y = a_[..., 0], a_[..., 1]
    columns = np.stack([np.stack([x, y], -1), np.stack([x, -y], -1), np.stack([y, x], -1)], axis=-1)
    root = np.linalg.cholesky(precision).transpose(0, 2, 1)
    columns, b = np.einsum("nij,vnjk->vnik", root, columns), np.einsum("nij,vnj->vni", root, b)
    ff = np.maximum((use * focal**2).sum(axis=0), 1e-12)

    def without_direction(rows: FloatArray) -> FloatArray:
        taken = np.einsum("vn,vn,vnk...->nk...", use, focal, rows) / ff.reshape(-1, *(1,) * (rows.ndim - 2))
        return rows - focal.reshape(*focal.shape, *(1,) * (rows.ndim - 2)) * taken

    columns, rest = without_direction(columns), without_direction(b)
    normal = np.einsum("vn,vnki,vnkj->nij", use, columns, columns)
    right = np.einsum("vn,vnki,vnk->ni", use, columns, rest)
    freedom = 2 * used.sum(axis=0) - 5
    scale = np.trace(normal, axis1=1, axis2=2) / 3.0
    determined = (freedom > 0) & (np.linalg.eigvalsh(normal)[:, 0] > 1e-3 * scale)
    normal[~determined] = np.eye(3)
    unknown = np.linalg.solve(normal, right[..., None])[..., 0]
    squares = np.einsum("vn,vnk,vnk->n", use, rest, rest) - (unknown * right).sum(axis=1)
    unknown[~determined] = np.nan
    w, d, e = unknown.T
    return TwoSlopes(
        matrices_mm=np.stack([np.stack([w + d, e], -1), np.stack([e, w - d], -1)], axis=-2),
        apart_mm=unknown[:, 1:],
        apart_covariance=np.linalg.inv(normal)[:, 1:, 1:],
        squares_px2=np.maximum(squares, 0.0),
        freedom=freedom,
    )


def moderated_variance(squares: FloatArray, freedom: NDArray[np.int64], prior_freedom: float) -> FloatArray:
    """Variances (n,) of points from their few residuals, shrunk towards the median variance of all.

    Squares are in px^2 of the keypoints' scales, and no variance is below MIN_NOISE_PX squared.

    Smyth, "Linear models and empirical Bayes methods", SAGMB 2004, with the prior variance from the median.
    """
    determined = freedom > 0
    if not determined.any():
        return np.ones(len(squares))
    usual = float(np.median(squares[determined] / freedom[determined]))
    moderated = (prior_freedom * usual + squares) / (prior_freedom + np.maximum(freedom, 0))
    return np.maximum(moderated, MIN_NOISE_PX**2)


def _equations(
    geometry: Geometry, seen_px: FloatArray, about_inverse_mm: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A (views, n, 2), b (views, n, 2) and f (views, n) of the law, in pixels; zero where nothing is seen."""
    seen = np.nan_to_num(seen_px)
    terms = [geometry.terms(view, seen[view]) for view in range(len(seen))]
    ahead = 1.0 - geometry.forward_mm[:, None] * about_inverse_mm
    a_, b = (np.stack(parts) / ahead[..., None] for parts in zip(*terms, strict=True))
    return a_, b, geometry.focal_px[:, None] / ahead
