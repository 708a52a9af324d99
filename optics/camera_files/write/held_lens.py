"""The lens of a view as a file format can hold it: itself, or the nearest one over the view's sub-image."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from mirrorcam.optics.camera_files.write.virtual_cameras import VirtualCamera
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.lenses.families import LensName
from mirrorcam.optics.geometry.nearest_lens import nearest_lens


@dataclass(frozen=True)
class HeldLens:
    """A view's camera in a format, and its largest distance in px from the view's own over the sub-image."""

    camera: Camera
    error_px: float


@dataclass(frozen=True)
class LensFormat:
    """The lenses that a format can hold.

    Attributes
    ----------
    families
        Lens models that it holds as they are.
    nearest
        The one that stands for all others.
    lacks
        Coefficients of `nearest` that it lacks.
    """

    families: frozenset[LensName]
    nearest: LensName
    lacks: Collection[str] = ()

    def of(self, view: VirtualCamera) -> HeldLens:
        """The lens of a view in this format: exact where it holds it, else fitted over the view's sub-image."""
        camera = view.camera
        exact = camera.lens_model in self.families
        if exact and camera.lens_model == self.nearest:
            exact = not any(
                value for name, value in zip(camera.lens.names, camera.distortion, strict=True) if name in self.lacks
            )
        if exact:
            return HeldLens(camera, 0.0)
        cut = view.sub_image
        first = np.array([cut.x, cut.y], dtype=np.float64)
        last = first + np.array([cut.width - 1, cut.height - 1])
        return HeldLens(*nearest_lens(camera, self.nearest, (first, last), self.lacks))


OPENCV = LensFormat(frozenset({"brown_conrady", "rational", "thin_prism", "fisheye"}), "thin_prism")
"""`cv2.projectPoints` takes 5, 8 or 12 numbers, `cv2.fisheye.projectPoints` the 4 of a fisheye lens."""
ROS = LensFormat(frozenset({"brown_conrady", "rational", "fisheye"}), "rational")
"""`sensor_msgs/distortion_models.hpp`: plumb_bob, rational_polynomial, equidistant."""
COLMAP = LensFormat(frozenset({"brown_conrady", "rational", "fisheye"}), "rational")
"""FULL_OPENCV has k1 k2 p1 p2 k3 k4 k5 k6, OPENCV_FISHEYE k1 k2 k3 k4; its thin prisms are those of another fisheye."""
NERFSTUDIO = LensFormat(frozenset({"brown_conrady", "fisheye"}), "brown_conrady")
"""OPENCV has k1 k2 k3 p1 p2, OPENCV_FISHEYE k1 k2 k3 k4."""
KALIBR = LensFormat(frozenset({"brown_conrady", "fisheye"}), "brown_conrady", ("k3",))
"""pinhole-radtan is the lens of Brown and Conrady without k3, pinhole-equi the fisheye lens."""

FORMATS = {"OpenCV": OPENCV, "ROS": ROS, "COLMAP": COLMAP, "nerfstudio": NERFSTUDIO, "Kalibr": KALIBR}
