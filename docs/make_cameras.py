"""A picture of every camera of the library in its clip: `python -m docs.make_cameras docs/images/cameras.jpg`.

Each is drawn at its own scale, from the side of the scene and from above, with its clip in orange.
"""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np

from mirrorcam.cad.assembly.components import CAMERA_RGB, ITEM_RGB, camera_solid, item_solid, tessellated
from mirrorcam.cad.guide.shading import Pixels, Screen, ShadedBody, render
from mirrorcam.cad.parts.clip import plan_clip
from mirrorcam.cad.parts.part_solids import make_clip
from mirrorcam.cad.plan.fasteners import frame_along
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.part_plan import PurchasedItem
from mirrorcam.core.images.pictures import write_image
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera_library import camera_names, library

TILE_PX = (400, 330)
TITLE_PX, MARGINS_PX = 40, (20, 20)
COLUMNS = 5
CLIP_RGB = (0.93, 0.55, 0.20)
TO_VIEWER = np.array([0.45, 1.0, 0.8])


def axes() -> FloatArray:
    """Unit vectors (3, 3) right, up and towards the viewer, in the rig frame; up is along the lens axis."""
    to_viewer = TO_VIEWER / np.linalg.norm(TO_VIEWER)
    up = np.array([0.0, 0.0, 1.0]) - to_viewer[2] * to_viewer
    up /= np.linalg.norm(up)
    return np.array([np.cross(up, to_viewer), up, to_viewer])


def tile(name: str) -> Pixels:
    """A camera in its clip, with its screws, above its name."""
    hardware = HARDWARE.replaced(camera=library()[name].body)
    plan = plan_clip(hardware)
    bodies = [
        ShadedBody(np.asarray(tessellated(make_clip(plan)).triangles, dtype=np.float64), CLIP_RGB),
        ShadedBody(np.asarray(tessellated(camera_solid(hardware.camera)).triangles, dtype=np.float64), CAMERA_RGB),
    ]
    for screw in plan.nest.screws if plan.nest else ():
        frame = frame_along(screw.head, -screw.axis)
        mesh = tessellated(item_solid(PurchasedItem("screw", "M3", screw.length_mm, frame, np.zeros(3), ())))
        mesh.apply_transform(frame)
        bodies.append(ShadedBody(np.asarray(mesh.triangles, dtype=np.float64), ITEM_RGB["screw"]))
    points = np.concatenate([body.triangles.reshape(-1, 3) for body in bodies])
    picture = render(bodies, Screen.around(points, axes(), TILE_PX, MARGINS_PX))
    title = np.full((TITLE_PX, TILE_PX[0], 3), 255, np.uint8)
    text = library()[name].name
    (width, _), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.52, 1)
    origin = ((TILE_PX[0] - width) // 2, 26)
    cv2.putText(title, text, origin, cv2.FONT_HERSHEY_SIMPLEX, 0.52, (40, 44, 52), 1, cv2.LINE_AA)
    return np.concatenate([np.asarray(picture.image, dtype=np.uint8), title])


def gallery(names: tuple[str, ...]) -> Pixels:
    """Tiles of cameras in rows of `COLUMNS`."""
    tiles = [tile(name) for name in names]
    tiles += [np.full_like(tiles[0], 255)] * (-len(tiles) % COLUMNS)
    rows = [np.concatenate(tiles[start : start + COLUMNS], axis=1) for start in range(0, len(tiles), COLUMNS)]
    return np.concatenate(rows)


if __name__ == "__main__":
    write_image(Path(sys.argv[1]), gallery(camera_names()))
