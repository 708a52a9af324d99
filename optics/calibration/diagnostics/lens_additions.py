"""Larger lens models as additions to a calibration: what each takes the camera to, and which intrinsics it frees."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from types import MappingProxyType

from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.lenses.families import LensName
from mirrorcam.optics.geometry.nearest_lens import nearest_lens, whole_picture, with_lens

LENS_ADDITIONS: Mapping[str, LensName] = MappingProxyType(
    {"rational": "rational", "prism": "thin_prism", "fisheye": "fisheye", "spline": "spline"}
)
"""Additions by the lens model that has their numbers. A fisheye is no larger lens but another one."""

_FURTHER: Mapping[LensName, tuple[str, ...]] = MappingProxyType(
    {
        "brown_conrady": ("rational", "prism", "fisheye", "spline"),
        "rational": ("prism",),
        "thin_prism": (),
        "fisheye": (),
        "spline": (),
    }
)


def further_lenses(camera: Camera, additions: Collection[str]) -> tuple[str, ...]:
    """The additions to the lens of a camera that a model with some additions leaves."""
    if camera.lens_model == "thin_prism" and "prism" in additions and "rational" not in additions:
        return ("rational",)
    return tuple(name for name in _FURTHER[camera.lens_model] if name not in additions)


def with_addition(camera: Camera, addition: str) -> Camera:
    """The camera in the lens model of an addition: the same one, except for a fisheye, which is the nearest."""
    model = LENS_ADDITIONS[addition]
    if model == "fisheye":
        return nearest_lens(camera, model, whole_picture(camera))[0]
    return camera if addition == "rational" and camera.lens_model == "thin_prism" else with_lens(camera, model)


def free_intrinsics(camera: Camera, additions: Collection[str]) -> tuple[str, ...]:
    """Names of the intrinsics that a model with some additions frees: all, or those without a quotient's divisor."""
    without_divisor = "prism" in additions and "rational" not in additions
    return tuple(name for name in camera.intrinsic_names if not (without_divisor and name in {"k4", "k5", "k6"}))
