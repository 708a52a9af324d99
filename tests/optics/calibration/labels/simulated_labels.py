"""Labels of a walking animal in the direct view and in mirrors around it, with noise, wrong and swapped ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.labels.label_calibration import data_sheet_prior
from mirrorcam.optics.calibration.labels.label_table import LabelTable
from mirrorcam.optics.calibration.solver.observations import DIRECT
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.mirror import reflect

CAMERA = Camera(
    width_px=1280,
    height_px=1024,
    fx_px=1400.0,
    fy_px=1402.0,
    cx_px=650.0,
    cy_px=500.0,
    distortion=[-0.12, 0.08, 0.0005, -0.0006, 0.0],
)
SHEET = data_sheet_prior(CAMERA.width_px, CAMERA.height_px, 1400.0, 28.0)
"""Prior of a data sheet that states the focal length to 2 %."""
DISTANCE_MM = 600.0
# Normals of mirrors around a box 200 mm wide below the camera: left, right, top, bottom in the picture.
MIRRORS = ((-1.0, 0.0, 0.8), (1.0, 0.05, 0.9), (0.05, -1.0, 0.85), (-0.05, 1.0, 0.75))
LABELS = ("nose", "ear_left", "ear_right", "spine", "tail", "paw_fl", "paw_fr", "paw_hl", "paw_hr")
BODY_MM = np.array(
    [
        [50.0, 0, 0],
        [35, -10, -5],
        [35, 10, -5],
        [0, 0, -15],
        [-50, 0, -5],
        [25, -15, 15],
        [25, 15, 15],
        [-30, -18, 15],
        [-30, 18, 15],
    ]
)
SWAPPED = {1: 2, 2: 1, 5: 6, 6: 5, 7: 8, 8: 7}
"""Labels of the left and the right side."""


@dataclass(frozen=True)
class Simulated:
    """Labels and their truth: camera, virtual centres (m, 3), points (f, l, 3), and the mask (n,) of correct labels."""

    table: LabelTable
    camera: Camera
    centres: FloatArray
    points: FloatArray
    correct: NDArray[np.bool_]


def simulated(
    seed: int,
    *,
    mirrors: int = 3,
    frames: int = 60,
    noise_px: float = 1.0,
    wrong: float = 0.1,
    swapped: float = 0.05,
    seen: float = 0.85,
    camera: Camera = CAMERA,
    points: FloatArray | None = None,
) -> Simulated:
    """Simulate labels of an animal, or of given points (f, l, 3); each is seen with probability `seen`."""
    random = np.random.default_rng(seed)
    centres = []
    for normal in np.array(MIRRORS[:mirrors]):
        n = normal + random.normal(0.0, 0.05, 3)
        n /= np.linalg.norm(n)
        on_plane = np.array([0.0, 0.0, DISTANCE_MM]) + 130.0 * np.array([*np.sign(np.round(normal[:2])), 0.0])
        centres.append(2.0 * (n @ on_plane) * n)
    turn = random.uniform(-np.pi, np.pi, frames)
    cosine, sine = np.cos(turn), np.sin(turn)
    zero, one = np.zeros(frames), np.ones(frames)
    rotation = np.stack([cosine, -sine, zero, sine, cosine, zero, zero, zero, one], axis=1).reshape(-1, 3, 3)
    low, high = (-50.0, -50.0, DISTANCE_MM - 30.0), (50.0, 50.0, DISTANCE_MM + 30.0)
    shift = random.uniform(low, high, (frames, 3))
    body = BODY_MM + random.normal(0.0, 4.0, (frames, *BODY_MM.shape))
    if points is None:
        points = body @ rotation.transpose(0, 2, 1) + shift[:, None]
    exact = np.stack([camera.project(points), *(camera.project(reflect(points, c)) for c in centres)], axis=1)
    shape = exact.shape[:3]  # frames, views, labels
    pixels = exact + random.normal(0.0, noise_px, exact.shape)
    kind = random.uniform(size=shape)
    size = np.array([camera.width_px, camera.height_px])
    is_wrong = kind < wrong
    pixels[is_wrong] = random.uniform(0.0, size, (int(is_wrong.sum()), 2))
    is_swapped = np.zeros(shape, dtype=bool)
    # A swap exchanges two labels, so half as many are drawn.
    for frame, view, label in np.argwhere(kind > 1.0 - swapped / 2.0):
        if random.uniform() < 0.7 and int(label) in SWAPPED:
            other = (frame, view, SWAPPED[int(label)])
        else:
            other = (frame, (view + 1) % shape[1], label)
        here = (frame, view, label)
        if is_wrong[here] or is_wrong[other] or is_swapped[here] or is_swapped[other]:
            continue
        pixels[here], pixels[other] = pixels[other].copy(), pixels[here].copy()
        is_swapped[here] = is_swapped[other] = True
    visible = (random.uniform(size=shape) < seen) & np.isfinite(pixels).all(axis=3)
    frame, view, label = np.nonzero(visible)
    table = LabelTable(
        frames=tuple(str(number) for number in range(frames)),
        labels=LABELS,
        views=("direct", *(f"mirror {m}" for m in range(mirrors))),
        frame=frame,
        view=view + DIRECT,
        label=label,
        pixels=pixels[visible],
    )
    return Simulated(table, camera, np.array(centres), points, ~(is_wrong | is_swapped)[visible])


def sheet_camera(seed: int) -> Camera:
    """Draw a camera from the prior of its data sheet."""
    random = np.random.default_rng(1000 + seed)
    return SHEET.camera.with_intrinsics(random.multivariate_normal(SHEET.camera.intrinsics, SHEET.covariance))
