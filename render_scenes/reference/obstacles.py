"""Obstacles around the mirrors: rays cast against the bodies of a device by Mitsuba."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.render_scenes.reference.device_bodies import DeviceBody, body_shapes, near_mm


class BodyObstacles:
    """`truth.obstacles.Obstacles` of bodies in the frame of the camera; Mitsuba's variant must have been set."""

    def __init__(self, bodies: Sequence[DeviceBody]) -> None:
        import mitsuba as mi

        self._scene = mi.load_dict({"type": "scene", **body_shapes(bodies)})
        self._near_mm = near_mm(bodies)

    def free_mm(self, start: FloatArray, direction: FloatArray) -> FloatArray:
        """Length (...), mm, that rays from points (..., 3) along unit vectors (..., 3) go before a body stops them."""
        import drjit as dr
        import mitsuba as mi

        shape = np.shape(direction)[:-1]
        known = (np.isfinite(start) & np.isfinite(direction)).all(axis=-1).ravel()
        flat = [
            np.broadcast_to(values, (*shape, 3)).reshape(-1, 3)[known].astype(np.float32)
            for values in (start, direction)
        ]
        if dr.is_jit_v(mi.Float):
            rays = mi.Ray3f(*(mi.Point3f(values.T) for values in flat))
            found = np.array(self._scene.ray_intersect_preliminary(rays).t, dtype=np.float64)
        else:
            pairs = zip(*(values.tolist() for values in flat), strict=True)
            found = np.array([self._scene.ray_intersect_preliminary(mi.Ray3f(*pair)).t for pair in pairs])
        free = np.full(known.shape, np.nan)
        free[known] = found
        return free.reshape(shape)

    def free_from_pupil_mm(self, rays: FloatArray) -> FloatArray:
        """Length (...), mm, that unit rays (..., 3) go from the pupil; the camera's own body stops none of them."""
        before = (self._near_mm / rays[..., 2])[..., None] * rays
        return np.asarray(np.linalg.norm(before, axis=-1) + self.free_mm(before, rays))
