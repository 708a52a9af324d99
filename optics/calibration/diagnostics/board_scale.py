"""Tests of the common scale of all lengths, which reveal a wrongly stated size of the board's squares.

Each mirror shows the centre of the board at a distance proportional to the board's size. Reflected back, all of these
points coincide, but only at the right size. The ratio to the stated size reveals a size stated in a different unit.

A board whose squares are k times as large as stated scales all lengths by 1/k, and the pictures fit as well as before:
corners alone cannot reveal it. Two kinds of lengths of the nominal layout can: the distances of the virtual centres,
and the positions of the mirrors' edges, which frames show as directions from the pupil. Both vary with a hobbyist's
building tolerances and the position of the camera; the remaining common factor is the scale.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.assignment import likely_mirror
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.detection.detect_boards import find_boards
from mirrorcam.optics.calibration.detection.segmentation import DetectedEdge
from mirrorcam.optics.calibration.solver.initial_estimates import camera_from_flat_board
from mirrorcam.optics.geometry.boards import AprilGrid, CalibrationBoard
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.tolerances import Tolerances
from mirrorcam.optics.geometry.transforms import transform

UNITS = ((10.0, "cm"), (25.4, "inches"), (1000.0, "m"))
MAX_UNIT_RATIO = 1.15  # of the ratio of the sizes to the ratio of two units
MIN_SIZE_RATIO = 1.5  # of the sizes: more than an inaccurate print can explain
MIN_CORRELATION = 0.9  # correlation between the apparent positions of the board and the mirrors' positions
TOLERANCES = Tolerances.hobby()
"""Standard deviations of a device from its layout, as a prior."""
IN_PLANE_MM = 0.3  # shift of a mirror along its own plane, in a pocket of this clearance
CUT_MM = 0.1  # common error of the cut of all mirrors: half of an uncompensated kerf
EDGE_MM = 0.2  # error of a single edge, in cutting and detection
OUTLIER_SIGMAS = 2.0  # residual in sigmas above which an edge loses weight, for example of a mirror cut by hand
ROUNDS = 20
ALARM_SIGMAS, REFUSED_DEVIATION = 3.5, 0.1
NOTED_SIGMAS, NOTED_DEVIATION = 2.0, 0.01


def wrong_size_message(pictures: Sequence[Grey], layout: Layout, board: CalibrationBoard) -> str | None:
    """Describe that pictures through a layout's mirrors fit a board of a different size; None if they do not."""
    ratio = size_ratio(pictures, layout, board)
    if ratio is None or 1.0 / MIN_SIZE_RATIO < ratio < MIN_SIZE_RATIO:
        return None
    side, element = (board.tag_mm, "tags") if isinstance(board, AprilGrid) else (board.square_mm, "squares")
    reported = f"board says {element} of {side:g} mm, the pictures fit about"
    for factor, unit in UNITS:
        if max(ratio / factor, factor / ratio) < MAX_UNIT_RATIO:
            return f"{reported} {side * factor:.3g} mm: were they measured in {unit}?"
    return (
        f"{reported} {side * ratio:.2g} mm in this layout: does the board or the layout belong to a different device?"
    )


def size_ratio(pictures: Sequence[Grey], layout: Layout, board: CalibrationBoard) -> float | None:
    """Return the board's size implied by pictures, relative to the stated one; None if they are inconsistent."""
    from_boards, from_layout = [], []
    for picture in pictures:
        boards = _board_centres(picture, layout, board)
        if len(boards) < 2:
            continue
        centres = np.array([layout.mirrors[mirror].apparent.virtual_centre_in_rig_mm for mirror in boards])
        points = np.array(list(boards.values()))
        normals = centres / np.linalg.norm(centres, axis=1, keepdims=True)
        reflected = points - 2.0 * np.sum(points * normals, axis=1, keepdims=True) * normals
        from_boards.append(reflected - reflected.mean(axis=0))
        from_layout.append(centres.mean(axis=0) - centres)
    if not from_boards:
        return None
    apparent, nominal = np.concatenate(from_boards), np.concatenate(from_layout)
    agreement = float(np.sum(apparent * nominal) / max(np.linalg.norm(apparent) * np.linalg.norm(nominal), 1e-12))
    return float(np.linalg.norm(nominal) / np.linalg.norm(apparent)) if agreement > MIN_CORRELATION else None


def _board_centres(picture: Grey, layout: Layout, board: CalibrationBoard) -> dict[int, FloatArray]:
    """Return the apparent centre (3,) of the largest board in each mirror, rig frame, mm, assuming the stated size."""
    centres: dict[int, FloatArray] = {}
    centre = board.corners_in_board_mm.mean(axis=0, keepdims=True)
    for detected, *_ in find_boards(picture, board, mirrored=True, max_boards=2 * len(layout.mirrors)):
        mirror = likely_mirror(detected, layout)
        if mirror is None or mirror in centres:
            continue
        pose = camera_from_flat_board(layout.camera, detected, board.corners_in_board_mm)
        if pose is not None:
            centres[mirror] = transform(pose, centre)[0]
    return centres


@dataclass(frozen=True)
class CommonScale:
    """All lengths relative to those of the nominal layout, and the standard deviation of this factor."""

    factor: float
    sigma: float

    def deviates(self, sigmas: float, min_deviation: float) -> bool:
        """Return whether it differs from 1 by more than `min_deviation` and more than `sigmas` standard deviations."""
        return abs(self.factor - 1.0) > max(min_deviation, sigmas * self.sigma)


def common_scale(
    layout: Layout, virtual_centres: FloatArray, edges: Sequence[Mapping[int, DetectedEdge]] = ()
) -> CommonScale:
    """Determine the common scale of all lengths relative to the nominal layout.

    Least squares over one factor, a shift and a rotation of the camera, a shift in each mirror's plane, and one
    error of the cut. Each mirror's tilt and shift along its normal are errors of its virtual centre. Outlying edges
    lose weight. If the device deviates by more than its tolerances, the standard deviation grows accordingly.

    Parameters
    ----------
    layout
        The nominal layout.
    virtual_centres
        The calibrated virtual centres (m, 3) in the rig frame, mm.
    edges
        Visible edges of each mirror, relative to its nominal outline on its calibrated plane.
    """
    visible = [(mirror, edge) for mirror, mirror_edges in enumerate(edges) for edge in mirror_edges.values()]
    centre_rows, centre_values = _centre_rows(layout, virtual_centres)
    edge_rows = np.array([_edge_row(layout, mirror, edge) for mirror, edge in visible])
    edge_rows = edge_rows.reshape(-1, centre_rows.shape[1])
    edge_values = np.array([edge.offset_mm / EDGE_MM for _, edge in visible])
    prior = _prior(len(layout.mirrors))
    rows = np.concatenate([centre_rows, edge_rows, prior])
    values = np.concatenate([centre_values, edge_values, np.zeros(len(prior))])
    edge_part = slice(len(centre_values), len(centre_values) + len(visible))
    weight = np.ones(len(values))
    for _ in range(ROUNDS if visible else 1):
        solution = np.linalg.lstsq(weight[:, None] * rows, weight * values, rcond=None)[0]
        residual = rows @ solution - values
        weight[edge_part] = 1.0 / np.sqrt(1.0 + (residual[edge_part] / OUTLIER_SIGMAS) ** 2)
    residual, rows = weight * residual, weight[:, None] * rows
    excess = max(1.0, float(np.sqrt(residual @ residual / max(len(centre_values) + len(visible) - 1, 1))))
    return CommonScale(1.0 + float(solution[0]), excess * float(np.sqrt(np.linalg.inv(rows.T @ rows)[0, 0])))


def _centre_rows(layout: Layout, virtual_centres: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rows (3m, 8 + 2m) and values (3m,) of the virtual centres, in standard deviations."""
    nominal = layout.virtual_centres_in_rig_mm
    count = len(nominal)
    lengths = np.linalg.norm(nominal, axis=1)
    normals = -nominal / lengths[:, None]
    normal_projection = normals[:, :, None] * normals[:, None, :]
    design = np.zeros((count, 3, 8 + 2 * count))
    design[:, :, 0] = nominal
    # A pupil displaced by t moves each virtual centre by -2 (n.t) n.
    design[:, :, 1:4] = -2.0 * normal_projection
    design[:, :, 4:7] = -np.stack([np.cross(axis, nominal) for axis in np.eye(3)], axis=2)
    plane_projection = np.eye(3) - normal_projection
    tilt_mm = np.radians(TOLERANCES.tilt_deg) * lengths
    covariance = (2.0 * TOLERANCES.offset_mm) ** 2 * normal_projection + tilt_mm[:, None, None] ** 2 * plane_projection
    whiten = np.linalg.inv(np.linalg.cholesky(covariance))
    rows = (whiten @ design).reshape(3 * count, -1)
    return rows, np.einsum("mij,mj->mi", whiten, virtual_centres - nominal).ravel()


def _edge_row(layout: Layout, mirror: int, edge: DetectedEdge) -> FloatArray:
    """Row (8 + 2m,) of an edge's offset, in standard deviations."""
    midpoint, outward = edge.midpoint_in_rig_mm, edge.outward_in_rig
    row = np.zeros(8 + 2 * len(layout.mirrors))
    row[0] = outward @ midpoint
    row[1:4] = -outward
    row[4:7] = -np.cross(midpoint, outward)  # -(axis x midpoint) . outward, for each axis
    row[7] = 1.0
    row[8 + 2 * mirror : 10 + 2 * mirror] = outward @ layout.mirrors[mirror].rig_from_plane[:3, :2]
    return row / EDGE_MM


def _prior(mirrors: int) -> FloatArray:
    """Rows (7 + 2m, 8 + 2m) of a zero-mean prior on all unknowns except the factor."""
    rotation = np.radians(TOLERANCES.camera_turn_deg)
    sigmas = [*[TOLERANCES.camera_offset_mm] * 3, *[rotation] * 3, CUT_MM, *[IN_PLANE_MM] * (2 * mirrors)]
    return np.eye(8 + 2 * mirrors)[1:] / np.array(sigmas)[:, None]


def scale_doubt(
    layout: Layout,
    virtual_centres: FloatArray,
    edges: Sequence[Mapping[int, DetectedEdge]],
    side_mm: float,
    element: Literal["square", "tag"] = "square",
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return alarms and notes on the common scale; raise InputError if it is so wrong that the board must differ."""
    scale = common_scale(layout, virtual_centres, edges)
    fitting_mm, sigma_mm = side_mm / scale.factor, side_mm * scale.sigma / scale.factor**2
    message = (
        f"the board's {element}s look like {fitting_mm:.4g} ± {sigma_mm:.2g} mm, board says {element}_mm = "
        f"{side_mm:g}: all lengths come out {scale.factor:.3f} (±{scale.sigma:.3f}) times those of the nominal "
        f"layout; measure the print, correct {element}_mm and calibrate again"
    )
    if scale.deviates(ALARM_SIGMAS, REFUSED_DEVIATION):
        raise InputError(message)
    if scale.deviates(ALARM_SIGMAS, NOTED_DEVIATION):
        return (message,), ()
    return ((), (message,)) if scale.deviates(NOTED_SIGMAS, NOTED_DEVIATION) else ((), ())
