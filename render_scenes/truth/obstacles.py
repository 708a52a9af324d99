"""Interface of the truth to obstacles around the mirrors: the lengths of rays until a body stops them."""

from __future__ import annotations

from typing import Protocol

from mirrorcam.core.values import FloatArray


class Obstacles(Protocol):
    """Opaque bodies around the mirrors of a device, in the frame of its camera."""

    def free_mm(self, start: FloatArray, direction: FloatArray) -> FloatArray:
        """Length (...) that rays go before a body stops them.

        Parameters
        ----------
        start
            Origins (..., 3) in rig, mm.
        direction
            Unit vectors (..., 3) in rig.

        Returns
        -------
        FloatArray
            Lengths (...), mm; infinite where nothing stops a ray, NaN where its origin or direction is NaN.
        """

    def free_from_pupil_mm(self, rays: FloatArray) -> FloatArray:
        """Length (...), mm, that unit rays (..., 3) go from the pupil; the camera's own body stops none of them."""
