"""The point-plane correspondence of parallel views: a point's position in all views, linear in direction and slope.

With w = 1 / Z the inverse distance of a point from the reference view and a = (X / Z, Y / Z) its direction from there,
the pinhole of a view at p_i = (x_i, y_i), z_i is

    b_i = f_i a + w A_i,    b_i = u_i - c_i,    A_i = z_i b_i - f_i p_i,

in units of (1 - z_i w) pixels; for z_i = 0, this is the two-plane form (u, v) = (D / P_z) (P_x - s, P_y - t). A point
seen in or through a curved surface has two slopes, along perpendicular directions (rays stay perpendicular to
wavefronts, so the matrix below is symmetric):

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
class ViewGeometry:
    """Geometry of n views as flat arrays: focal lengths, principal points, and positions in the view frame."""

    focal_px: FloatArray
    centre_px: FloatArray
    lateral_mm: FloatArray
    axial_mm: FloatArray
    reference: int

    @classmethod
    def of(cls, views: Views) -> ViewGeometry:
        matrices, positions = views.matrices.reshape(-1, 3, 3), views.positions_mm.reshape(-1, 3)
        return cls(
            focal_px=matrices[:, 0, 0],
            centre_px=matrices[:, :2, 2],
            lateral_mm=positions[:, :2],
            axial_mm=positions[:, 2],
            reference=int((positions**2).sum(axis=1).argmin()),
        )

    def directions(self, pixels: FloatArray) -> FloatArray:
        """Return the directions a (n, 2) of pixels (n, 2) of the reference view."""
        return (pixels - self.centre_px[self.reference]) / self.focal_px[self.reference]

    def predict(self, view: int, directions: FloatArray, inverse_distance: FloatArray | float) -> FloatArray:
        """Return the pixels (n, 2) in a view of points with directions (n, 2) and inverse distances (n,), 1/mm."""
        w = np.asarray(inverse_distance, dtype=np.float64)[..., None]
        relative_depth = 1.0 - self.axial_mm[view] * w
        return self.focal_px[view] * (directions - self.lateral_mm[view] * w) / relative_depth + self.centre_px[view]

    def terms(self, view: int, pixels: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return A and b (n, 2) for pixels (n, 2) in a view."""
        b = pixels - self.centre_px[view]
        return self.axial_mm[view] * b - self.focal_px[view] * self.lateral_mm[view], b


@dataclass(frozen=True, eq=False)
class SlopeFit:
    """Least-squares fit of points to the views that see them.

    Attributes
    ----------
    directions
        Directions a (n, 2).
    inverse_distance
        Inverse distances w (n,), 1/mm.
    distances_px
        Distance (views, n) between the observed and the fitted pixel of a point; NaN if not observed.
    information
        Fisher information (n,) on w, mm^2, for noise of one pixel: the variance of w is noise^2 / information.
    squares_px2
        Sum (n,) of squared distances over the views used, weighted by the precision.
    dof
        Degrees of freedom (n,): measured coordinates minus the three unknowns.
    """

    directions: FloatArray
    inverse_distance: FloatArray
    distances_px: FloatArray
    information: FloatArray
    squares_px2: FloatArray
    dof: NDArray[np.int64]


def fit_slope(
    geometry: ViewGeometry,
    observed_px: FloatArray,
    used: NDArray[np.bool_],
    approx_inverse_distance: FloatArray,
    precision: FloatArray,
) -> SlopeFit:
    """Fit one slope to points observed at pixels (views, n, 2) in the views `used` (views, n).

    `approx_inverse_distance` (n,) only sets the units of the equations, by factors (1 - z_i w) close to 1. `precision`
    (n, 2, 2) is the relative precision along u and v, with mean 1.

    A point used in no view but the reference has information 0 and slope NaN.
    """
    slope_terms, b, focal = _equations(geometry, observed_px, approx_inverse_distance)
    cholesky = np.linalg.cholesky(precision).transpose(0, 2, 1)
    slope_terms, b = np.einsum("nij,vnj->vni", cholesky, slope_terms), np.einsum("nij,vnj->vni", cholesky, b)
    weight = used.astype(np.float64)
    ff = np.maximum((weight * focal**2).sum(axis=0), 1e-12)
    fa = np.einsum("vn,vn,vnk->nk", weight, focal, slope_terms)
    fb = np.einsum("vn,vn,vnk->nk", weight, focal, b)
    information = np.einsum("vn,vnk,vnk->n", weight, slope_terms, slope_terms) - (fa * fa).sum(axis=1) / ff
    w = (np.einsum("vn,vnk,vnk->n", weight, slope_terms, b) - (fa * fb).sum(axis=1) / ff) / np.where(
        information > 1e-6 * ff, information, np.nan
    )
    directions = (fb - w[:, None] * fa) / ff[:, None]
    residual = b - focal[..., None] * directions - w[:, None] * slope_terms
    squares = (residual**2).sum(axis=2)
    unweighted = np.linalg.inv(cholesky)
    distances = np.linalg.norm(np.einsum("nij,vnj->vni", unweighted, residual), axis=2)
    return SlopeFit(
        directions=np.einsum("nij,nj->ni", unweighted, directions),
        inverse_distance=w,
        distances_px=np.where(np.isfinite(observed_px[..., 0]), distances, np.nan),
        information=information,
        squares_px2=(weight * squares).sum(axis=0),
        dof=2 * used.sum(axis=0) - 3,
    )


def agreeing_views(
    geometry: ViewGeometry,
    observed_px: FloatArray,
    approx_inverse_distance: FloatArray,
    precision: FloatArray,
    max_distance_px: float,
) -> NDArray[np.bool_]:
    """Return the mask (views, n) of views that see points within `max_distance_px` of where one slope predicts them.

    The limit decreases in steps, so that one wrong view affects only the first fit of a point.
    """
    observed = np.isfinite(observed_px[..., 0])
    used = observed.copy()
    for factor in (3.0, 1.5, 1.0, 1.0):
        fit = fit_slope(geometry, observed_px, used, approx_inverse_distance, precision)
        used = observed & (fit.distances_px <= factor * max_distance_px)
    return used


@dataclass(frozen=True, eq=False)
class TwoSlopes:
    """Slopes along s and t, estimated separately.

    Attributes
    ----------
    matrices
        Matrices W (n, 2, 2), 1/mm; NaN if the views used do not determine them.
    anisotropy
        Components d and e (n, 2), 1/mm.
    anisotropy_covariance
        Covariance (n, 2, 2) of d and e for noise of one pixel.
    squares_px2
        Sum (n,) of squared residual distances.
    dof
        Degrees of freedom (n,): measured coordinates minus the five unknowns.
    """

    matrices: FloatArray
    anisotropy: FloatArray
    anisotropy_covariance: FloatArray
    squares_px2: FloatArray
    dof: NDArray[np.int64]


def fit_two_slopes(
    geometry: ViewGeometry,
    observed_px: FloatArray,
    used: NDArray[np.bool_],
    approx_inverse_distance: FloatArray,
    precision: FloatArray,
) -> TwoSlopes:
    """Fit a symmetric matrix instead of the slope, otherwise like `fit_slope`."""
    slope_terms, b, focal = _equations(geometry, observed_px, approx_inverse_distance)
    weight = used.astype(np.float64)
    # Columns of the unknowns w, d, e in the two rows of each view, after projecting out a, which is also free.
    x, y = slope_terms[..., 0], slope_terms[..., 1]
    columns = np.stack([np.stack([x, y], -1), np.stack([x, -y], -1), np.stack([y, x], -1)], axis=-1)
    cholesky = np.linalg.cholesky(precision).transpose(0, 2, 1)
    columns, b = np.einsum("nij,vnjk->vnik", cholesky, columns), np.einsum("nij,vnj->vni", cholesky, b)
    ff = np.maximum((weight * focal**2).sum(axis=0), 1e-12)

    def project_out_direction(rows: FloatArray) -> FloatArray:
        fitted = np.einsum("vn,vn,vnk...->nk...", weight, focal, rows) / ff.reshape(-1, *(1,) * (rows.ndim - 2))
        return rows - focal.reshape(*focal.shape, *(1,) * (rows.ndim - 2)) * fitted

    columns, residual = project_out_direction(columns), project_out_direction(b)
    normal = np.einsum("vn,vnki,vnkj->nij", weight, columns, columns)
    rhs = np.einsum("vn,vnki,vnk->ni", weight, columns, residual)
    dof = 2 * used.sum(axis=0) - 5
    scale = np.trace(normal, axis1=1, axis2=2) / 3.0
    determined = (dof > 0) & (np.linalg.eigvalsh(normal)[:, 0] > 1e-3 * scale)
    normal[~determined] = np.eye(3)
    solution = np.linalg.solve(normal, rhs[..., None])[..., 0]
    squares = np.einsum("vn,vnk,vnk->n", weight, residual, residual) - (solution * rhs).sum(axis=1)
    solution[~determined] = np.nan
    w, d, e = solution.T
    return TwoSlopes(
        matrices=np.stack([np.stack([w + d, e], -1), np.stack([e, w - d], -1)], axis=-2),
        anisotropy=solution[:, 1:],
        anisotropy_covariance=np.linalg.inv(normal)[:, 1:, 1:],
        squares_px2=np.maximum(squares, 0.0),
        dof=dof,
    )


def moderated_variance(squares: FloatArray, dof: NDArray[np.int64], prior_dof: float) -> FloatArray:
    """Return variances (n,) of points from their few residuals, shrunk towards the median variance of all points.

    `squares` are in px^2 at the keypoints' scales; no variance is below MIN_NOISE_PX squared.

    Smyth, "Linear models and empirical Bayes methods", SAGMB 2004, with the prior variance from the median.
    """
    determined = dof > 0
    if not determined.any():
        return np.ones(len(squares))
    median = float(np.median(squares[determined] / dof[determined]))
    moderated = (prior_dof * median + squares) / (prior_dof + np.maximum(dof, 0))
    return np.maximum(moderated, MIN_NOISE_PX**2)


def _equations(
    geometry: ViewGeometry, observed_px: FloatArray, approx_inverse_distance: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return A (views, n, 2), b (views, n, 2) and f (views, n), in pixels; zero where nothing is observed."""
    pixels = np.nan_to_num(observed_px)
    terms = [geometry.terms(view, pixels[view]) for view in range(len(pixels))]
    relative_depth = 1.0 - geometry.axial_mm[:, None] * approx_inverse_distance
    slope_terms, b = (np.stack(parts) / relative_depth[..., None] for parts in zip(*terms, strict=True))
    return slope_terms, b, geometry.focal_px[:, None] / relative_depth
