"""Pictures of the mirror holder: a hidden-line drawing (SVG) and a shaded view with mirrors, pupil and light (PNG)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import trimesh
from build123d import Edge, GeomType, Part
from numpy.typing import NDArray

from cad.raster import Canvas, Screen, Surface
from cad.seats import Frustum, sheet
from optics.files import write_image, write_text
from optics.layout import Layout
from optics.values import FloatArray

# From in front of the mirrors, to the right and below: the side from which all of them are seen.
VIEWER_IN_VIEW = (0.95, 0.40, 1.0)
PLASTIC_RGB = (0.36, 0.39, 0.44)
MIRROR_RGB = (0.66, 0.85, 0.98)
LENS_RGB = (0.55, 0.57, 0.60)
LIGHT_RGB = (0.93, 0.50, 0.05)
INK_RGB = (0.11, 0.13, 0.18)
TEXT_PX = 26
LENS_RADIUS_MM = 7.0
LENS_LENGTH_MM = 9.0
PICTURE_PX = (1500, 1100)
SUPERSAMPLING = 2
SVG_WIDTH_MM = 180.0


def view_axes(layout: Layout) -> FloatArray:
    """Rows right, up and towards the viewer (3, 3) in rig, for the pictures of a layout."""
    towards = layout.view_from_rig.T @ np.array(VIEWER_IN_VIEW)
    towards /= np.linalg.norm(towards)
    up = -layout.view_from_rig[1]
    up = up - (up @ towards) * towards
    up /= np.linalg.norm(up)
    return np.array([np.cross(up, towards), up, towards])


def write_drawing(path: Path, part: Part, layout: Layout) -> None:
    """Write the hidden-line drawing of the part as SVG: visible edges dark, hidden ones thin and light, to scale."""
    axes = view_axes(layout)
    visible, hidden = part.project_to_viewport(tuple(1000.0 * axes[2]), tuple(axes[1]), (0.0, 0.0, 0.0))
    strokes = {"hidden": _polylines(hidden), "visible": _polylines(visible)}
    corners = np.vstack([np.vstack(lines) for lines in strokes.values() if lines])
    (left, bottom), (right, top) = corners.min(axis=0) - 4.0, corners.max(axis=0) + 4.0
    width, height = right - left, top - bottom
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{SVG_WIDTH_MM:.2f}mm" '
        f'height="{SVG_WIDTH_MM * height / width:.2f}mm" viewBox="0 0 {width:.2f} {height:.2f}">',
        f"<title>MirrorCam mirror holder, layout {layout.identity}</title>",
        f'<rect width="{width:.2f}" height="{height:.2f}" fill="#ffffff"/>',
    ]
    styles = {"hidden": ("#b9c0cc", 0.18), "visible": ("#1b222d", 0.32)}
    for name, lines in strokes.items():
        colour, thickness = styles[name]
        data = sorted(
            "M" + "L".join(f"{x:.2f} {y:.2f}" for x, y in np.column_stack([line[:, 0] - left, top - line[:, 1]]))
            for line in lines
        )
        parts.append(
            f'<path id="{name}" fill="none" stroke="{colour}" stroke-width="{thickness}" stroke-linecap="round" '
            f'stroke-linejoin="round" d="{"".join(data)}"/>'
        )
    write_text(path, "\n".join([*parts, "</svg>"]) + "\n")


def _polylines(edges: list[Edge]) -> list[FloatArray]:
    """Projected edges as polylines (n, 2): a straight one by its ends, a curve in 24 steps."""
    lines = []
    for edge in edges:
        steps = np.linspace(0.0, 1.0, 2 if edge.geom_type == GeomType.LINE else 25)
        lines.append(np.array([tuple(edge @ step)[:2] for step in steps]))
    return lines


def write_picture(path: Path, stl: Path, layout: Layout) -> None:
    """Write a shaded picture: the printed part with its mirrors, the lens, and a ray by each mirror of a middle column.

    The part is read from its STL file: the picture shows what is printed.
    """
    part = Surface(np.array(trimesh.load_mesh(stl).triangles), PLASTIC_RGB)
    mirrors = Surface(_triangles([sheet(mirror) for mirror in layout.mirrors]), MIRROR_RGB)
    lens = Surface(_triangles([_lens()]), LENS_RGB)
    paths = [_middle_ray(layout, row * layout.cols + layout.cols // 2) for row in range(layout.rows)]
    axes = view_axes(layout)
    corners = np.concatenate([*(s.triangles.reshape(-1, 3) for s in (part, lens)), *paths]) @ axes.T
    low, high = corners[:, :2].min(axis=0), corners[:, :2].max(axis=0)
    size = np.array(PICTURE_PX) * SUPERSAMPLING
    scale = float((0.84 * size / (high - low)).min())
    screen = Screen(axes, (low + high) / 2.0, scale, int(size[0]), int(size[1]))
    canvas = Canvas(screen)
    for surface in (part, mirrors, lens):
        canvas.fill(surface)
    canvas.outline()
    for ray in paths:
        canvas.line(ray, LIGHT_RGB, 2 * SUPERSAMPLING)
    top_left = part.triangles.reshape(-1, 3) @ (axes[1] - 0.5 * axes[0])
    words = (
        (np.zeros(3), (0.60, 0.95), "camera pupil (the lens looks up)"),
        (layout.mirrors[-1].outline_in_rig_mm.mean(axis=0), (0.03, 0.80), "flat mirror, glued into its seat"),
        (part.triangles.reshape(-1, 3)[top_left.argmax()], (0.03, 0.07), "printed mirror holder"),
        (paths[0][-1], (0.76, 0.07), "to and from the scene"),
    )
    image = canvas.shrunk(SUPERSAMPLING)
    _annotate(image, screen, words)
    write_image(path, image)


def _annotate(
    image: NDArray[np.uint8], screen: Screen, words: Sequence[tuple[FloatArray, tuple[float, float], str]]
) -> None:
    """Write words into the image at fractions of its width and height, each with an arrow to a point (3,) in rig."""
    font = cv2.FontFace("sans")
    ink = tuple(round(255 * channel) for channel in INK_RGB)
    height, width = image.shape[:2]
    for point, (across, down), text in words:
        origin = (int(across * width), int(down * height))
        left, top, wide, high = cv2.getTextSize((width, height), text, origin, font, TEXT_PX)
        cv2.putText(image, text, origin, ink, font, TEXT_PX)
        target = screen.pixels(point)[:2] / SUPERSAMPLING
        box = np.array([[left - 8, top - 8], [left + wide + 8, top + high + 8]])
        start = np.clip(target, box[0], box[1])
        # OpenCV draws to 1/8 px when it is given coordinates in eighths.
        tail, tip = (np.round(8.0 * end).astype(int).tolist() for end in (start, target))
        share = 14.0 / float(np.linalg.norm(target - start))
        cv2.arrowedLine(image, tail, tip, ink, 1, cv2.LINE_AA, shift=3, tipLength=share)


def _middle_ray(layout: Layout, index: int) -> FloatArray:
    """Pupil, middle of a mirror, and a point on the way to the scene: (3, 3) in rig, mm."""
    mirror = layout.mirrors[index]
    middle = mirror.outline_in_rig_mm.mean(axis=0)
    length = 1.3 * np.linalg.norm(layout.mirrors[layout.central_index].outline_in_rig_mm.mean(axis=0))
    direction = middle - mirror.virtual_centre_in_rig_mm
    return np.array([np.zeros(3), middle, middle + length * direction / np.linalg.norm(direction)])


def _lens() -> Frustum:
    """A drum behind the pupil that stands for the camera's lens."""
    angle = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
    ring = LENS_RADIUS_MM * np.column_stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)])
    return Frustum(ring - (0.0, 0.0, LENS_LENGTH_MM), ring)


def _triangles(volumes: list[Frustum]) -> FloatArray:
    """The faces of convex volumes as triangles (n, 3, 3)."""
    fans = []
    for face in (face for volume in volumes for face in volume.faces):
        first = np.broadcast_to(face[0], (len(face) - 2, 3))
        fans.append(np.stack([first, face[1:-1], face[2:]], axis=1))
    return np.concatenate(fans)
