"""Conversion of a camera to another lens model: exact if the model includes its lens, else a fit with its error."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from scipy.optimize import least_squares

from mirrorcam.core.bounds import FOCAL_PX
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera import DEPTH_NAMES, Camera
from mirrorcam.optics.geometry.lenses.families import FIXED_SIZE_FAMILIES, LensName
from mirrorcam.optics.geometry.lenses.spline import LensGrid, Spline

SAMPLES = 40  # along each side of the fitted part of the picture
EXACT_PX = 1e-9
PRIOR_PX = 1e-3  # residual of the prior for a coefficient of one prior sigma


def with_lens(camera: Camera, model: LensName) -> Camera:
    """The camera in another model: it keeps the coefficients that both models have; the others are zero.

    The result is equivalent if all coefficients that the other model lacks are zero. A fisheye's coefficients have a
    different meaning, so none is kept. A spline lens gets a grid over the entire sensor.
    """
    if model == camera.lens_model:
        return camera
    common = "fisheye" not in (model, camera.lens_model)
    coefficients = dict(zip(camera.lens.names, camera.distortion, strict=True)) if common else {}
    grid = None if model != "spline" else LensGrid.covering(_border(camera))
    names = FIXED_SIZE_FAMILIES[model].NAMES if grid is None else Spline(np.zeros(0), grid).names
    return camera.replaced(lens_model=model, lens_grid=grid, distortion=[coefficients.get(name, 0.0) for name in names])


def _border(camera: Camera) -> FloatArray:
    """Normalized coordinates (n, 2) of the sensor's border, where the lens is defined."""
    fractions = np.linspace(-0.5, 0.5, SAMPLES)
    x, y = fractions * camera.width_px, fractions * camera.height_px
    edges = [np.column_stack(np.broadcast_arrays(*edge)) for edge in ((x[0], y), (x[-1], y), (x, y[0]), (x, y[-1]))]
    centre = np.array([camera.width_px - 1.0, camera.height_px - 1.0]) / 2.0
    normalized = camera.normalized_from_pixels(np.concatenate(edges) + centre)
    valid = np.isfinite(normalized).all(axis=1)
    if not valid.any():
        raise InputError(f"camera {camera.name}: its lens is not defined at the border of the sensor")
    return np.asarray(normalized[valid])


def nearest_lens(
    camera: Camera, model: LensName, part: tuple[FloatArray, FloatArray] | None = None, zero: Collection[str] = ()
) -> tuple[Camera, float]:
    """The nearest camera with another lens model over a part of the picture, and its largest error there, px.

    Focal lengths, principal point and coefficients are fitted by least squares. They are valid only within this part.

    Parameters
    ----------
    camera
        The camera to approximate.
    model
        The other lens model.
    part
        First and last pixel (2,) of the part; by default, the entire picture.
    zero
        Coefficients to fix at zero.

    Raises
    ------
    InputError
        If the camera's own lens is not defined in the part, or the fit to the other model fails.
    """
    terms = {name: getattr(camera, name) for name in DEPTH_NAMES}
    if any(value is not None for value in terms.values()):  # no lens model depends on them
        in_focus, error_px = nearest_lens(camera.in_focus, model, part, zero)
        return in_focus.replaced(**terms), error_px
    if part is None:
        part = np.zeros(2), np.array([camera.width_px - 1.0, camera.height_px - 1.0])
    pixels = np.stack(np.meshgrid(*np.linspace(*part, SAMPLES).T), axis=-1).reshape(-1, 2)
    normalized = camera.normalized_from_pixels(pixels)
    valid = np.isfinite(normalized).all(axis=1)
    if not valid.any():
        raise InputError(f"camera {camera.name}: its lens is not defined from pixel {part[0]} to {part[1]}")
    rays, pixels = np.column_stack([normalized[valid], np.ones(valid.sum())]), pixels[valid]
    fitted = with_lens(camera, model)
    names = fitted.intrinsic_names
    fitted = fitted.with_intrinsics(np.where([name in zero for name in names], 0.0, fitted.intrinsics))
    free = [index for index, name in enumerate(names) if name not in zero]
    if _max_error_px(fitted, rays, pixels) < EXACT_PX:
        return fitted, 0.0
    with np.errstate(all="ignore"):  # intermediate lenses may overflow
        try:
            best = fitted.with_intrinsics(_least_squares(fitted, free, rays, pixels))
        except (ValueError, np.linalg.LinAlgError):  # not finite, or not a valid camera
            raise InputError(f"camera {camera.name}: no {model} lens fits its own, choose a different model") from None
        error_px = _max_error_px(best, rays, pixels)
    if not np.isfinite(error_px):
        raise InputError(f"camera {camera.name}: no {model} lens fits its own, choose a different model")
    return best, error_px


def _least_squares(start: Camera, free: Sequence[int], rays: FloatArray, pixels: FloatArray) -> FloatArray:
    """The intrinsics (k,) that fit the pixels of rays best; only those at the indices `free` vary."""

    def camera(values: FloatArray) -> Camera:
        intrinsics = start.intrinsics.copy()
        intrinsics[free] = values
        return start.with_intrinsics(intrinsics)

    # Where pixels hardly determine coefficients, the prior selects the smallest.
    sigmas = start.prior_sigmas[free]
    prior = np.diag(PRIOR_PX / sigmas)[np.isfinite(sigmas)]

    def residuals(values: FloatArray) -> FloatArray:
        errors = camera(values).project_with_jacobians(rays)[0] - pixels
        return np.concatenate([errors.ravel(), prior @ values])

    def jacobian(values: FloatArray) -> FloatArray:
        d_free = camera(values).project_with_jacobians(rays)[2][:, :, free].reshape(-1, len(free))
        return np.concatenate([d_free, prior])

    min_values = np.where(np.isin(free, [0, 1]), FOCAL_PX.min, -np.inf)
    fit = least_squares(
        residuals,
        start.intrinsics[free],
        jac=jacobian,
        bounds=(min_values, np.inf),
        x_scale="jac",
        xtol=1e-12,
        ftol=1e-12,
    )
    return camera(fit.x).intrinsics


def _max_error_px(camera: Camera, rays: FloatArray, pixels: FloatArray) -> float:
    return float(np.linalg.norm(camera.project_with_jacobians(rays)[0] - pixels, axis=1).max())
