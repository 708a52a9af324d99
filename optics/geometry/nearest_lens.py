"""A camera in another lens model: exact where the model holds its lens, else fitted to it, with the largest error."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from scipy.optimize import least_squares

from mirrorcam.core.bounds import FOCAL_PX
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera import PINHOLE_NAMES, Camera
from mirrorcam.optics.geometry.lenses.families import NUMBERED, LensName
from mirrorcam.optics.geometry.lenses.spline import LensGrid, Spline

SAMPLES = 40  # across and down the fitted part of the picture
EXACT_PX = 1e-9
LEAST_PX = 1e-3  # error that a coefficient is worth which has the size of its prior


def with_lens(camera: Camera, model: LensName) -> Camera:
    """The camera in another model, with the coefficients that both name and the others zero.

    Where the other model has all coefficients that are not zero, it is the same camera. Those of a fisheye lens mean
    something else: none is kept. A spline lens gets a grid over the whole sensor.
    """
    if model == camera.lens_model:
        return camera
    common = "fisheye" not in (model, camera.lens_model)
    kept = dict(zip(camera.lens.names, camera.distortion, strict=True)) if common else {}
    grid = None if model != "spline" else LensGrid.covering(_border(camera))
    names = NUMBERED[model].NAMES if grid is None else Spline(np.zeros(0), grid).names
    return camera.replaced(lens_model=model, lens_grid=grid, distortion=[kept.get(name, 0.0) for name in names])


def _border(camera: Camera) -> FloatArray:
    """Normalized coordinates (n, 2) of the border of the sensor, as far as the lens is defined there."""
    along = np.linspace(-0.5, 0.5, SAMPLES)
    x, y = along * camera.width_px, along * camera.height_px
    edges = [np.column_stack(np.broadcast_arrays(*edge)) for edge in ((x[0], y), (x[-1], y), (x, y[0]), (x, y[-1]))]
    middle = np.array([camera.width_px - 1.0, camera.height_px - 1.0]) / 2.0
    normalized = camera.normalized_from_pixels(np.concatenate(edges) + middle)
    known = np.isfinite(normalized).all(axis=1)
    if not known.any():
        raise InputError(f"camera {camera.name}: its lens is not defined at the border of the sensor")
    return np.asarray(normalized[known])


def nearest_lens(
    camera: Camera, model: LensName, part: tuple[FloatArray, FloatArray], held: Collection[str] = ()
) -> tuple[Camera, float]:
    """The camera of another model that is nearest to one over a part of its picture, and its largest error there, px.

    Focal lengths, principal point and coefficients are fitted by least squares: they describe this part and nothing
    beyond it.

    Parameters
    ----------
    camera
        The camera to describe.
    model
        The other lens model.
    part
        First and last pixel (2,) of the part.
    held
        Coefficients that are zero.

    Raises
    ------
    InputError
        Where the camera's own lens is not defined in the part, or nothing of the other model is near it.
    """
    pixels = np.stack(np.meshgrid(*np.linspace(*part, SAMPLES).T), axis=-1).reshape(-1, 2)
    normalized = camera.normalized_from_pixels(pixels)
    known = np.isfinite(normalized).all(axis=1)
    if not known.any():
        raise InputError(f"camera {camera.name}: its lens is not defined from pixel {part[0]} to {part[1]}")
    rays, pixels = np.column_stack([normalized[known], np.ones(known.sum())]), pixels[known]
    fitted = with_lens(camera, model)
    names = fitted.intrinsic_names
    fitted = fitted.with_intrinsics(np.where([name in held for name in names], 0.0, fitted.intrinsics))
    free = [place for place, name in enumerate(names) if name not in held]
    if _worst(fitted, rays, pixels) < EXACT_PX:
        return fitted, 0.0
    with np.errstate(all="ignore"):  # of lenses far from any that is made
        try:
            best = fitted.with_intrinsics(_least_squares(fitted, free, rays, pixels))
        except (ValueError, np.linalg.LinAlgError):  # numbers that are not finite, or of no camera
            raise InputError(f"camera {camera.name}: no {model} lens is near its own, expected another lens") from None
        error_px = _worst(best, rays, pixels)
    if not np.isfinite(error_px):
        raise InputError(f"camera {camera.name}: no {model} lens is near its own, expected another lens")
    return best, error_px


def _least_squares(start: Camera, free: Sequence[int], rays: FloatArray, pixels: FloatArray) -> FloatArray:
    """The intrinsics (k,), of which those at the places `free` are changed, that meet pixels of rays best."""

    def camera(values: FloatArray) -> Camera:
        intrinsics = start.intrinsics.copy()
        intrinsics[free] = values
        return start.with_intrinsics(intrinsics)

    # Of coefficients that hardly matter, the smallest are taken.
    sigmas = np.array([*[np.inf] * len(PINHOLE_NAMES), *start.lens.prior_sigmas])[free]
    least = np.diag(LEAST_PX / sigmas)[np.isfinite(sigmas)]

    def residuals(values: FloatArray) -> FloatArray:
        off = camera(values).project_with_jacobians(rays)[0] - pixels
        return np.concatenate([off.ravel(), least @ values])

    def jacobian(values: FloatArray) -> FloatArray:
        by_free = camera(values).project_with_jacobians(rays)[2][:, :, free].reshape(-1, len(free))
        return np.concatenate([by_free, least])

    lowest = np.where(np.isin(free, [0, 1]), FOCAL_PX.least, -np.inf)
    found = least_squares(
        residuals, start.intrinsics[free], jac=jacobian, bounds=(lowest, np.inf), x_scale="jac", xtol=1e-12, ftol=1e-12
    )
    return camera(found.x).intrinsics


def _worst(camera: Camera, rays: FloatArray, pixels: FloatArray) -> float:
    return float(np.linalg.norm(camera.project_with_jacobians(rays)[0] - pixels, axis=1).max())


def whole_picture(camera: Camera) -> tuple[FloatArray, FloatArray]:
    """First and last pixel of a camera's picture."""
    return np.zeros(2), np.array([camera.width_px - 1.0, camera.height_px - 1.0])
