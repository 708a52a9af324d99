"""A calibration board before a camera, with or without mirrors, as a Mitsuba scene. World = rig frame, mm.

The board shines by itself, so that no lamp adds noise; mirrors are exactly as the layout cuts them; all else is black.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from optics.camera import Camera
from optics.mirror import Mirror
from optics.targets import DICTIONARIES, Charuco, Checkerboard
from optics.values import FloatArray, InputError
from render_scenes.dataset import RenderSettings
from render_scenes.integrator import integrator, render
from render_scenes.llvm import use_variant
from render_scenes.sensor import sensor

MARGIN_SQUARES = 1  # of white paper around the printed squares
_MOST_TEXELS_PER_SQUARE = 64


def texels_per_square(target: Checkerboard | Charuco) -> int:
    """How finely to sample the print so that its edges fall between texels.

    One texel a square is exact for a checkerboard. With markers, one texel a marker module is exact where a square is a
    whole number of modules; otherwise the count up to 64 that moves a marker's edges least.
    """
    if isinstance(target, Checkerboard):
        return 1
    modules = DICTIONARIES[target.dictionary][1]
    module_mm = target.marker_mm / modules
    best, least = 0, np.inf
    for texels in range(modules + 1, _MOST_TEXELS_PER_SQUARE + 1):
        for per_module in range(1, (texels - 1) // modules + 1):
            if (texels - per_module * modules) % 2:
                continue  # the marker would not be centred
            off_mm = abs(per_module * target.square_mm / texels - module_mm)
            if off_mm < least - 1e-9:
                best, least = texels, off_mm
    return best


def print_on_paper(target: Checkerboard | Charuco) -> NDArray[np.uint8]:
    """The sheet: the print with its margin of white paper, 0 ink and 255 paper."""
    texels = texels_per_square(target)
    return np.pad(target.image(texels), MARGIN_SQUARES * texels, constant_values=255)


def world_from_sheet(target: Checkerboard | Charuco, rig_from_board: FloatArray) -> FloatArray:
    """The 4x4 that lays Mitsuba's rectangle ([-1, 1]^2, shining along +z, v up) on the sheet, printed side out."""
    width, height = target.size_mm
    margin = MARGIN_SQUARES * target.square_mm
    board_from_sheet = np.diag([width / 2 + margin, -(height / 2 + margin), -1.0, 1.0])
    board_from_sheet[:2, 3] = width / 2, height / 2
    return rig_from_board @ board_from_sheet


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
    turn = np.cross(outline[1] - outline[0], outline - outline[0]).sum()
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
        sheet = print_on_paper(target)[
            ::-1
        ]  # Mitsuba's v = 0 is the first row of the bitmap and y = -1 of the rectangle
        radiance = settings.ink + (settings.paper - settings.ink) * np.float32(sheet) / 255.0
        self.scene = mi.load_dict(
            {
                "type": "scene",
                "board": {
                    "type": "rectangle",
                    "to_world": mi.ScalarTransform4f(world_from_sheet(target, np.eye(4))),
                    "bsdf": {"type": "diffuse", "reflectance": {"type": "uniform", "value": 0.0}},
                    "emitter": {
                        "type": "area",
                        "radiance": {
                            "type": "bitmap",
                            "bitmap": mi.Bitmap(np.float32(radiance)),
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

        self._parameters["board.to_world"] = mi.Transform4f(world_from_sheet(self.target, rig_from_board))
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
