"""Surface finish of each mirror: reflectance, roughness and deviation from its plane."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from pydantic import Field

from mirrorcam.core.values import FloatArray, Value
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.render_scenes.settings import Bend, RenderSettings, SurfaceFinish


class MirrorFinish(Value):
    """Surface finish of one mirror: linear reflectance in red, green and blue, roughness, sag and ripple.

    Directions are anticlockwise from the x axis of the mirror's frame `plane`.
    """

    reflectance: tuple[float, float, float]
    roughness: float = Field(
        default=0.0, ge=0, description="alpha of the Beckmann microfacet distribution: rms slope times root 2"
    )
    bend: Bend = "sphere"
    sag_mm: float = Field(default=0.0, description="depth of the centre below the rim")
    sag_direction_deg: float = 0.0
    ripple_mm: float = Field(default=0.0, ge=0, description="amplitude of the surface waviness")
    ripple_wavelength_mm: float = Field(default=20.0, gt=0)
    ripple_direction_deg: float = 0.0
    ripple_phase_deg: float = 0.0

    @property
    def flat(self) -> bool:
        """True if the surface is a plane."""
        return self.sag_mm == 0.0 and self.ripple_mm == 0.0

    @cached_property
    def luminance(self) -> float:
        """Reflectance of white light for a monochrome camera (luma coefficients of ITU-R BT.709)."""
        if len(set(self.reflectance)) == 1:
            return self.reflectance[0]
        return float(np.dot([0.212671, 0.715160, 0.072169], self.reflectance))

    def bent(self, mirror: Mirror) -> Mirror:
        """Return the mirror with the sag of this finish as its curvature, without the ripple."""
        u_axis, v_axis = _axes(self.sag_direction_deg)
        bends = np.outer(u_axis, u_axis) + (np.outer(v_axis, v_axis) if self.bend == "sphere" else 0.0)
        (xx, xy), (_, yy) = 2e3 * self.sag_mm / radius_mm(mirror) ** 2 * bends
        curvature = mirror.curvature_per_m + np.array([xx, yy, xy])
        shifted = mirror.moved(np.eye(3), -0.5 * self.sag_mm * mirror.normal_in_rig)
        return shifted.replaced(curvature_per_m=curvature)

    def shape(self, radius_mm: float, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the height of the surface over the plane and its slopes.

        Parameters
        ----------
        radius_mm
            Radius at which the surface is half the sag above the plane; at the centre it is half the sag below.
        points
            Points (..., 2) of the plane in the mirror's frame `plane`, mm.

        Returns
        -------
        height
            (...), mm, positive towards the pupil.
        slopes
            (..., 2), derivatives of the height with respect to x and y.
        """
        u_axis, v_axis = _axes(self.sag_direction_deg)
        curvature = self.sag_mm / radius_mm**2
        u, v = points @ u_axis, points @ v_axis
        spherical = 1.0 if self.bend == "sphere" else 0.0
        height = curvature * (u**2 + spherical * v**2) - 0.5 * self.sag_mm
        slopes = 2.0 * curvature * (u[..., None] * u_axis + spherical * v[..., None] * v_axis)
        ripple_axis, _ = _axes(self.ripple_direction_deg)
        wavenumber = 2.0 * np.pi / self.ripple_wavelength_mm
        phase = wavenumber * (points @ ripple_axis) + np.deg2rad(self.ripple_phase_deg)
        ripple_slope = self.ripple_mm * wavenumber * np.cos(phase)
        return height + self.ripple_mm * np.sin(phase), slopes + ripple_slope[..., None] * ripple_axis


def _axes(angle_deg: float) -> tuple[FloatArray, FloatArray]:
    """Return unit vectors (2,) along a direction and perpendicular to it."""
    angle = np.deg2rad(angle_deg)
    return np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])


def radius_mm(mirror: Mirror) -> float:
    """Return the distance of a mirror's farthest corner from its centre."""
    return float(np.linalg.norm(mirror.outline_in_plane_mm, axis=1).max())


def uniform_finishes(settings: RenderSettings, count: int) -> tuple[MirrorFinish, ...]:
    """Return the finishes of smooth, flat mirrors with the reflectance of the settings."""
    return (MirrorFinish(reflectance=(settings.mirror_reflectance,) * 3),) * count


def draw_finishes(settings: RenderSettings, count: int, random: np.random.Generator) -> tuple[MirrorFinish, ...]:
    """Draw the surface finish of each mirror; empty if the settings request ideal mirrors.

    With the same generator state, deviations are proportional to the magnitudes in the settings.
    """
    finish = settings.finish
    if finish == SurfaceFinish():
        return ()
    finishes = []
    for brightness, sag in random.standard_normal((count, 2)):
        sag_direction, ripple_direction, phase = random.uniform(0.0, [180.0, 180.0, 360.0])
        mean_reflectance = settings.mirror_reflectance * (1.0 + finish.reflectance_percent / 100.0 * brightness)
        red, green, blue = (float(np.clip(mean_reflectance * tint, 0.0, 1.0)) for tint in finish.tint)
        finishes.append(
            MirrorFinish(
                reflectance=(red, green, blue),
                roughness=finish.roughness,
                bend=finish.bend,
                sag_mm=finish.sag_mm * float(sag),
                sag_direction_deg=float(sag_direction),
                ripple_mm=finish.ripple_mm,
                ripple_wavelength_mm=finish.ripple_wavelength_mm,
                ripple_direction_deg=float(ripple_direction),
                ripple_phase_deg=float(phase),
            )
        )
    return tuple(finishes)
