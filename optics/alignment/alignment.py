"""How each mirror is turned from its design, told from edges of sub-images and, better, from what the views share.

From frames of any scene and the nominal layout alone. Two sources stand side by side:

- edges: where each mirror's sub-image ends. Edges lie on the mirror and hardly move when it turns: a tilt of 0.4
  degrees lifts an edge 10 mm from the middle by 0.07 mm, about a pixel, and a mirror that is cut 0.1 mm too large, or
  lies 0.2 mm beside its place, moves its edges as much. The Cramer-Rao bound of the default device is 0.15 to 0.3
  degrees, however sharp the edges are seen, and outer mirrors with two edges on the sensor tell one axis of the two at
  most. Edges do tell how the camera sits, and which mirror is far from its place.
- scene: content of a mirror moves by twice its turn. Points that several views share tell turns to hundredths of a
  degree, where the scene has texture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray, InputError
from mirrorcam.optics.alignment.build_errors import BuildErrors, BuiltDevice
from mirrorcam.optics.alignment.edge_fit import EdgeFit, EdgeFitter
from mirrorcam.optics.geometry.layout import Layout

Source = Literal["edges", "scene"]
TOLD = 0.7
"""A tilt is told where its standard deviation is less than this part of what was known before."""


@dataclass(frozen=True)
class MirrorTilt:
    """What pictures tell of the tilt of one mirror.

    Attributes
    ----------
    index
        Of the mirror.
    right_deg, down_deg
        Angles by which the mirror is turned from its design, about the axes of its plane: positive where its view turns
        to the right and down, by about twice as much. NaN where the pictures do not tell.
    sigma_deg
        Standard deviations of both.
    estimate_deg
        The most likely tilts, right and down, also where the pictures hardly tell them: near 0 then.
    """

    index: int
    right_deg: float
    down_deg: float
    sigma_deg: tuple[float, float]
    estimate_deg: tuple[float, float] = (0.0, 0.0)

    @property
    def told(self) -> bool:
        """Whether anything is told."""
        return bool(np.isfinite(self.right_deg) or np.isfinite(self.down_deg))

    @property
    def words(self) -> str:
        """The tilt in words: "0.40° left, 0.20° up"; what is less than its standard deviation is left out."""
        parts = []
        for value, sigma, names in zip(
            (self.right_deg, self.down_deg), self.sigma_deg, (("left", "right"), ("up", "down")), strict=True
        ):
            if np.isfinite(value) and abs(value) >= sigma:
                parts.append(f"{abs(value):.2f}° {names[value > 0]}")
        return ", ".join(parts) or ("straight" if self.told else "cannot tell")


@dataclass(frozen=True, eq=False)
class Alignment:
    """What pictures tell of a device, by one source.

    Attributes
    ----------
    source
        What tells it.
    mirrors
        Of each mirror.
    camera_shift_mm, camera_shift_sigma_mm
        How the pupil is shifted (3,) from its place in the holder, in rig.
    camera_turn_deg, camera_turn_sigma_deg
        How the camera is turned (3,) in the holder, a rotation vector in rig.
    edges
        The fit to edges; None of the scene.
    points
        Number of points of the scene; 0 of edges.
    """

    source: Source
    mirrors: tuple[MirrorTilt, ...]
    camera_shift_mm: FloatArray
    camera_shift_sigma_mm: FloatArray
    camera_turn_deg: FloatArray
    camera_turn_sigma_deg: FloatArray
    edges: EdgeFit | None = None
    points: int = 0


def view_turns(layout: Layout, index: int) -> FloatArray:
    """Signs (2,): of a view's turn to the right by a tilt about the mirror's own y, and of one down by one about x."""
    mirror = layout.mirrors[index].apparent
    frame, normal = mirror.rig_from_plane, mirror.normal_in_rig
    ray = frame[:3, 3] / np.linalg.norm(frame[:3, 3])
    signs = np.ones(2)
    for place, (axis, which) in enumerate(((1, 0), (0, 1))):
        change = np.cross(frame[:3, axis], normal)
        turned = -2.0 * ((change @ ray) * normal + (normal @ ray) * change)
        signs[place] = 1.0 if (layout.view_from_rig @ turned)[which] >= 0.0 else -1.0
    return signs


def mirror_tilt(layout: Layout, index: int, tilts: FloatArray, covariance: FloatArray, before_deg: float) -> MirrorTilt:
    """The tilt of a mirror by its turns (2,) about its own x and y, rad, with their covariance (2, 2).

    `before_deg` is the standard deviation that was known before.
    """
    right, down = view_turns(layout, index)
    sigma = np.degrees(np.sqrt(np.maximum(np.diag(covariance), 0.0)))[::-1]
    value = np.degrees(np.array([right * tilts[1], down * tilts[0]]))
    told = np.where(sigma < TOLD * before_deg, value, np.nan)
    deviation, estimate = (float(sigma[0]), float(sigma[1])), (float(value[0]), float(value[1]))
    return MirrorTilt(index, float(told[0]), float(told[1]), deviation, estimate)


def grey_light(frames: Sequence[NDArray[np.uint8]], layout: Layout) -> NDArray[np.float32]:
    """The mean (h, w) of frames (h, w, 3) in RGB or (h, w), grey levels.

    Raises InputError where there is none, or one of another size than the layout's camera's.
    """
    if not frames:
        raise InputError("no frame is given, expected one or more")
    expected = (layout.camera.height_px, layout.camera.width_px)
    total = np.zeros(expected, np.float32)
    for frame in frames:
        if frame.shape[:2] != expected:
            given = f"{frame.shape[1]}x{frame.shape[0]}"
            raise InputError(f"frame is {given} px, expected {expected[1]}x{expected[0]} of the layout's camera")
        total += frame if frame.ndim == 2 else cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY)
    return total / np.float32(len(frames))


class EdgeAligner:
    """Tells from the edges of sub-images how the mirrors of one layout are turned; keep one for all frames.

    Parameters
    ----------
    layout
        The nominal layout.
    errors
        What errors of building are expected; by default those of a device made by hand.
    """

    def __init__(self, layout: Layout, errors: BuildErrors | None = None) -> None:
        self.layout, self.errors = layout, BuildErrors.of(layout) if errors is None else errors
        self._fitter = EdgeFitter(BuiltDevice(layout, self.errors))

    def align(self, frames: Sequence[NDArray[np.uint8]], near: Alignment | None = None) -> Alignment:
        """What the mean of frames (h, w, 3) or (h, w) tells; the more the scene changes between them, the better.

        A white sheet before the mirrors tells most. With `near`, what was found before of the same device, it is
        searched about that, ten times as fast.

        Raises InputError for no frames, or of another size than the layout's camera's.
        """
        start = None if near is None or near.edges is None else near.edges.errors
        fit = self._fitter.fit(grey_light(frames, self.layout), start)
        device, sigma = fit.device, fit.device.sigma
        covariance = fit.covariance * sigma[:, None] * sigma
        sized, deviation = fit.errors * sigma, np.sqrt(np.diag(covariance))
        mirrors = []
        for k in range(len(self.layout.mirrors)):
            at = device.tilts(k)
            mirrors.append(mirror_tilt(self.layout, k, sized[at], covariance[at, at], self.errors.tilt_deg))
        return Alignment(
            "edges",
            tuple(mirrors),
            sized[:3],
            deviation[:3],
            np.degrees(sized[3:6]),
            np.degrees(deviation[3:6]),
            edges=fit,
        )
