"""A camera in another lens model: exact where the model holds its lens, else fitted to it, with the largest error."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from scipy.optimize import least_squares

from mirrorcam.optics.base.values import FloatArray, InputError
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.lenses.families import FAMILIES, LensName

SAMPLES = 40  # across and down the fitted part of the picture
EXACT_PX = 1e-9


def with_lens(camera: Camera, model: LensName) -> Camera:
    """The camera in another model, with the coefficients that both name and the others zero.

    Where the other model has all coefficients that are not zero, it is the same camera. Those of a fisheye lens mean
    something else: none is kept.
    """
    if model == camera.lens_model:
        return camera
    kept = (
        {} if "fisheye" in (model, camera.lens_model) else dict(zip(camera.lens.names, camera.distortion, strict=True))
    )
    return camera.replaced(lens_model=model, distortion=[kept.get(name, 0.0) for name in FAMILIES[model].NAMES])


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
        Where the camera's own lens is not defined in the part.
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
    best = fitted.with_intrinsics(_least_squares(fitted, free, rays, pixels))
    return best, _worst(best, rays, pixels)


def _least_squares(start: Camera, free: Sequence[int], rays: FloatArray, pixels: FloatArray) -> FloatArray:
    """The intrinsics (k,), of which those at the places `free` are changed, that meet pixels of rays best."""

    def camera(values: FloatArray) -> Camera:
        intrinsics = start.intrinsics.copy()
        intrinsics[free] = values
        return start.with_intrinsics(intrinsics)

    def residuals(values: FloatArray) -> FloatArray:
        return np.asarray((camera(values).project_with_jacobians(rays)[0] - pixels).ravel())

    def jacobian(values: FloatArray) -> FloatArray:
        return np.asarray(camera(values).project_with_jacobians(rays)[2][:, :, free].reshape(-1, len(free)))

    found = least_squares(
        residuals, start.intrinsics[free], jac=jacobian, method="lm", x_scale="jac", xtol=1e-12, ftol=1e-12
    )
    return camera(found.x).intrinsics


def _worst(camera: Camera, rays: FloatArray, pixels: FloatArray) -> float:
    return float(np.linalg.norm(camera.project_with_jacobians(rays)[0] - pixels, axis=1).max())


def whole_picture(camera: Camera) -> tuple[FloatArray, FloatArray]:
    """First and last pixel of a camera's picture."""
    return np.zeros(2), np.array([camera.width_px - 1.0, camera.height_px - 1.0])
