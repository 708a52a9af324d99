"""A calibration board before a camera, with or without mirrors, as a Mitsuba scene. World = rig frame, mm.

The board shines by itself, so that no lamp adds noise; mirrors are exactly as the layout cuts them; all else is black.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from optics.camera import Camera
from optics.mirror import Mirror
from optics.targets import Charuco, Checkerboard
from optics.values import FloatArray, InputError
from render_scenes.integrator import integrator, render
from render_scenes.llvm import use_variant
from render_scenes.sensor import sensor
from render_scenes.settings import RenderSettings
from render_scenes.sheet import print_on_paper, world_from_sheet


def mirror_shape(mirror: Mirror, reflectance: float) -> Any:
    """A first-surface mirror as a fan of triangles, black behind, with the exact normal at every corner.

    The normals of the triangles themselves would carry the rounding of their corners.
    """
    import mitsuba as mi

    if mirror.surface != "first":
        raise InputError(
            "mirror with its coating behind (surface 'second'): the renderer has first-surface mirrors only"
        )
    corners = mirror.outline_in_rig_mm
    outline = mirror.outline_in_plane_mm
    edges = np.roll(outline, -1, axis=0) - outline
    turn = (outline[:, 0] * edges[:, 1] - outline[:, 1] * edges[:, 0]).sum()
    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict(
        {
            "type": "conductor",
            "material": "none",
            "specular_reflectance": {"type": "uniform", "value": reflectance},
        }
    )
    count = len(corners)
    mesh = mi.Mesh("mirror", count, count - 2, props=properties, has_vertex_normals=True)
    fan = np.array([[0, k, k + 1] if turn > 0 else [0, k + 1, k] for k in range(1, count - 1)])
    buffers = mi.traverse(mesh)
    buffers["vertex_positions"] = np.float32(corners).ravel()
    buffers["vertex_normals"] = np.tile(np.float32(mirror.normal_in_rig), count)
    buffers["faces"] = np.uint32(fan).ravel()
    buffers.update()
    return mesh


class BoardScene:
    """A board that can be moved, seen by a camera by way of mirrors (or, without any, directly).

    Moving the board costs no compilation. `variant` is Mitsuba's, by default the fastest that this machine can run.
    """

    def __init__(
        self,
        camera: Camera,
        mirrors: tuple[Mirror, ...],
        target: Checkerboard | Charuco,
        settings: RenderSettings,
        *,
        variant: str | None = None,
    ) -> None:
        self.variant = use_variant(variant)
        import mitsuba as mi

        self.camera, self.target = camera, target
        # Mitsuba's v = 0 is the first row of the bitmap and y = -1 of the rectangle.
        sheet = print_on_paper(target)[::-1]
        radiance = settings.ink + (settings.paper - settings.ink) * (sheet / 255.0)
        self.scene = mi.load_dict(
            {
                "type": "scene",
                "board": {
                    "type": "rectangle",
                    "to_world": mi.ScalarTransform4f(world_from_sheet(target, np.eye(4)).astype(np.float32)),
                    "bsdf": {"type": "diffuse", "reflectance": {"type": "uniform", "value": 0.0}},
                    "emitter": {
                        "type": "area",
                        "radiance": {
                            "type": "bitmap",
                            "bitmap": mi.Bitmap(radiance.astype(np.float32)),
                            "raw": True,
                            "filter_type": "nearest",
                            "wrap_mode": "clamp",
                        },
                    },
                },
                **{f"mirror_{i}": mirror_shape(m, settings.mirror_reflectance) for i, m in enumerate(mirrors)},
            }
        )
        self.sensor = sensor(camera)
        # Whatever stands between the mirrors of a real device hides the scene behind it.
        self.integrator = integrator(mirrors_only=bool(mirrors))
        self._parameters = mi.traverse(self.scene)

    def place_board(self, rig_from_board: FloatArray) -> None:
        """Move the board to a rigid 4x4 pose in mm."""
        import mitsuba as mi

        self._parameters["board.to_world"] = mi.Transform4f(
            world_from_sheet(self.target, rig_from_board).astype(np.float32)
        )
        self._parameters.update()

    def render(
        self, *, spp: int, seed: int, subpixels: int = 1, crop: tuple[int, int, int, int] | None = None
    ) -> NDArray[np.float32]:
        """Radiance, float32, of the whole sensor or of a window x, y, width, height.

        Shape (h * subpixels, w * subpixels): each pixel is cut into squares, each of `spp` samples.
        """
        use_variant(self.variant)
        window = (0, 0, self.camera.width_px, self.camera.height_px) if crop is None else crop
        return render(self.scene, self.sensor, self.integrator, crop=window, subpixels=subpixels, spp=spp, seed=seed)
