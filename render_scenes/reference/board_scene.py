"""A calibration board in front of a camera, with or without mirrors, as a Mitsuba scene in the rig frame, mm.

The board emits light, so no light source adds noise. Mirrors have the outlines of the layout; the rest is black.
The parts of a device, if given, occlude the scene and scatter the light of the board and of the surroundings, whose
radiance is uniform.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.boards import CalibrationBoard
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.render_scenes.boards import printed_radiance, rig_from_rectangle
from mirrorcam.render_scenes.mirror_finish import MirrorFinish, uniform_finishes
from mirrorcam.render_scenes.reference.camera_sensor import sensor
from mirrorcam.render_scenes.reference.device_bodies import DeviceBody, body_shapes, near_mm
from mirrorcam.render_scenes.reference.integrator import PLATE_BRANCHES, PathOptions, integrator, render
from mirrorcam.render_scenes.reference.mirror_shapes import mirror_shapes
from mirrorcam.render_scenes.settings import RenderSettings
from mirrorcam.render_scenes.variant import use_variant


class BoardScene:
    """A movable board, seen by a camera via mirrors or, without mirrors, directly.

    Moving the board needs no compilation.

    Parameters
    ----------
    camera
        The camera, at the origin of the rig frame.
    mirrors
        The mirrors; empty for the bare camera.
    board
        The board.
    settings
        Samples, light and reflectance.
    finishes
        Surface finishes of the mirrors; by default, they are uniform, smooth and flat.
    bodies
        Bodies of a device around the mirrors.
    variant
        Mitsuba's variant; by default the fastest available.
    """

    def __init__(
        self,
        camera: Camera,
        mirrors: tuple[Mirror, ...],
        board: CalibrationBoard,
        settings: RenderSettings,
        *,
        finishes: Sequence[MirrorFinish] = (),
        bodies: Sequence[DeviceBody] = (),
        variant: str | None = None,
    ) -> None:
        self.variant = use_variant(variant)
        import mitsuba as mi

        self.camera, self.board = camera, board
        finishes = finishes or uniform_finishes(settings, len(mirrors))
        self.scene = mi.load_dict(
            {
                "type": "scene",
                "board": _emitting_board(board, settings),
                **{
                    f"mirror_{index}_{face}": shape
                    for index, (mirror, finish) in enumerate(zip(mirrors, finishes, strict=True))
                    for face, shape in mirror_shapes(mirror, finish, edges=bool(bodies)).items()
                },
                **body_shapes(bodies),
                **({"sky": {"type": "constant", "radiance": settings.surroundings}} if bodies else {}),
            }
        )
        self.sensor = sensor(camera, pupil=settings.sensor.pupil, near_mm=near_mm(bodies))
        self.integrator = integrator(_path_options(mirrors, finishes, bodies))
        self._parameters = mi.traverse(self.scene)

    def place_board(self, rig_from_board: FloatArray) -> None:
        """Move the board to a rigid pose (4, 4), mm."""
        import mitsuba as mi

        self._parameters["board.to_world"] = mi.Transform4f(
            rig_from_rectangle(self.board, rig_from_board).astype(np.float32)
        )
        self._parameters.update()

    def render(
        self, *, spp: int, seed: int, subpixels: int = 1, crop: tuple[int, int, int, int] | None = None
    ) -> NDArray[np.float32]:
        """Render the radiance of the full sensor, or of a window `crop` = x, y, width, height in pixels.

        Returns float32 (h * subpixels, w * subpixels), with `spp` samples per subpixel.
        """
        use_variant(self.variant)
        window = (0, 0, self.camera.width_px, self.camera.height_px) if crop is None else crop
        return render(self.scene, self.sensor, self.integrator, crop=window, subpixels=subpixels, spp=spp, seed=seed)


def _emitting_board(board: CalibrationBoard, settings: RenderSettings) -> dict[str, Any]:
    """Describe a rectangle that emits the radiance of the print, at the identity pose."""
    import mitsuba as mi

    # Mitsuba's v = 0 is the first row of the bitmap and y = -1 of the rectangle.
    radiance = printed_radiance(board, settings)[::-1]
    texture = {
        "type": "bitmap",
        "bitmap": mi.Bitmap(radiance.astype(np.float32)),
        "raw": True,
        "filter_type": "nearest",
        "wrap_mode": "clamp",
    }
    return {
        "type": "rectangle",
        "to_world": mi.ScalarTransform4f(rig_from_rectangle(board, np.eye(4)).astype(np.float32)),
        "bsdf": {"type": "diffuse", "reflectance": {"type": "uniform", "value": 0.0}},
        "emitter": {"type": "area", "radiance": texture},
    }


def _path_options(
    mirrors: Sequence[Mirror], finishes: Sequence[MirrorFinish], bodies: Sequence[DeviceBody]
) -> PathOptions:
    # Parts between the mirrors of a device occlude the scene behind them; without parts these pixels are black.
    rough = any(finish.roughness > 0.0 for finish in finishes)
    plates = any(mirror.is_second_surface for mirror in mirrors)
    return PathOptions(
        mirrors_only=bool(mirrors) and not bodies,
        branches=PLATE_BRANCHES if plates else 1,
        lit=bool(bodies) or rough,
        max_bounces=16 if plates else 8,
    )
