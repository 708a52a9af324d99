"""Detection under stress, and its speed against OpenCV's: `python -m benchmarks.detection [LAYOUT] [--json FILE]`.

Frames of mirrors tilted by 2 degrees (sigma) are rendered for a good and for a poor camera, undisturbed and with glare,
motion blur, little light, strong compression, and all of these at once. Prints, for each, the percentage of visible
corners that are detected, their error, and the number of false corners: those more than 1 px, or 5 of their standard
deviations (scaled to the errors of that mirror's corners in the run, and at least 0.1 px), from the true position.

Then the processor time of a frame of nine views at 1920 x 1080 (limit: 0.5 s) for each kind of board. OpenCV
also detects AprilGrids, in the flipped part of the frame that each mirror is known to fill, with `cornerSubPix`.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np

from benchmarks.records import SIGMA, Rows, add_json_option, write_record
from mirrorcam.core.images.pictures import read_image
from mirrorcam.core.processes.worker_pool import cores
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.charuco import marker_corners
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.detection.detect_boards import detect_frames, detect_sub_images
from mirrorcam.optics.calibration.detection.joint_numbering import number_jointly
from mirrorcam.optics.calibration.pupil_estimate import unvignetted
from mirrorcam.optics.calibration.solver.observations import Observations
from mirrorcam.optics.geometry.boards import (
    TAG_BORDER,
    TAG_FAMILY,
    AprilGrid,
    CalibrationBoard,
    Checkerboard,
    default_board,
)
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.tolerances import Tolerances
from mirrorcam.render_scenes.sets.dataset import Dataset
from mirrorcam.render_scenes.sets.render_set import render_set
from mirrorcam.render_scenes.sets.set_request import SetRequest
from mirrorcam.render_scenes.settings import SENSORS, RenderSettings, SensorName

DEFAULT_LAYOUT = Path(__file__).parents[1] / "tests" / "data" / "default_layout.json"
TILT_DEG = 2.0
FALSE_PX, FALSE_SIGMAS = 1.0, 5.0
MIN_FALSE_PX = 0.1  # below which no corner is called false, however small the others' errors are
FRAME_LIMIT_S = 0.5
RUNS, TIMED_FRAMES = 3, 4
PLAIN = Checkerboard(cols=20, rows=13, square_mm=12.0)
TAGS = AprilGrid(cols=10, rows=7, tag_mm=18.0, spacing=0.3)
PEER_WINDOW = (2, 2)  # half of OpenCV's window around a corner, px
CONDITIONS = ("undisturbed", "glare", "motion blur", "dim", "JPEG 40", "all at once")


def degraded(grey: Grey, condition: str, random: np.random.Generator) -> Grey:
    """Return a frame under one of the `CONDITIONS`."""
    light = grey.astype(np.float32)
    all_at_once = condition == "all at once"
    if condition == "motion blur" or all_at_once:
        length, angle = random.uniform(2.0, 5.0), random.uniform(0.0, np.pi)
        kernel = np.zeros((15, 15), np.float32)
        for step in np.linspace(-length / 2.0, length / 2.0, 41):
            x, y = 7.0 + step * np.cos(angle), 7.0 + step * np.sin(angle)
            column, row, right, down = int(x), int(y), x % 1.0, y % 1.0
            kernel[row : row + 2, column : column + 2] += np.outer([1.0 - down, down], [1.0 - right, right])
        light = np.asarray(cv2.filter2D(light, -1, kernel / kernel.sum()), dtype=np.float32)
    if condition == "glare" or all_at_once:
        y, x = np.mgrid[: grey.shape[0], : grey.shape[1]].astype(np.float32)
        for _ in range(6):
            u, v, size = random.uniform(0, grey.shape[1]), random.uniform(0, grey.shape[0]), random.uniform(15, 70)
            light += random.uniform(100, 900) * np.exp(-((x - u) ** 2 + (y - v) ** 2) / np.float32(2.0 * size**2))
    if condition == "dim" or all_at_once:
        light = np.clip(light, 0, 255) * (0.5 if all_at_once else 0.25)
        light += random.normal(0.0, 1.5, grey.shape).astype(np.float32)
    picture = np.clip(np.rint(light), 0, 255).astype(np.uint8)
    if condition == "JPEG 40" or all_at_once:
        encoded = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 40])[1]
        picture = np.asarray(cv2.imdecode(encoded, cv2.IMREAD_GRAYSCALE), dtype=np.uint8)
    return picture


@dataclass(frozen=True)
class Score:
    """Detection score of several frames.

    `visible` and `found` are numbers of corners, `rms_px` is the error per axis of those within `FALSE_PX`; `far` is
    the number of others, `outlying` the number with errors above `FALSE_SIGMAS` standard deviations.
    """

    visible: int
    found: int
    rms_px: float
    far: int
    outlying: int

    @property
    def false(self) -> int:
        return max(self.far, self.outlying)


def score(detected: list[Observations], truth_px: FloatArray, visible: int) -> Score:
    """Compare corners with true pixels (frames, mirrors, corners, 2)."""
    errors = np.concatenate([o.pixels - truth_px[frame][o.view, o.corner] for frame, o in enumerate(detected)])
    views, sigma_px = (np.concatenate([getattr(o, name) for o in detected]) for name in ("view", "sigma_px"))
    distance = np.linalg.norm(errors, axis=1)
    far = ~(distance <= FALSE_PX)
    near = errors[~far]
    outlying = far.copy()
    for view in np.unique(views):
        # Each mirror has its own light and sharpness. Rayleigh's median, 1.177 sigma, is robust to a few outliers.
        mask = views == view
        scale = float(np.median(distance[mask] / sigma_px[mask])) / 1.1774
        limit = np.maximum(FALSE_SIGMAS * scale * sigma_px[mask], MIN_FALSE_PX)
        outlying[mask] |= (np.abs(errors[mask]) > limit[:, None]).any(axis=1)
    rms = float(np.sqrt(np.mean(near**2))) if len(near) else float("nan")
    return Score(visible, len(errors), rms, int(far.sum()), int(outlying.sum()))


def _used(layout: Layout, corners: Observations) -> Observations:
    """Return the corners that a calibration uses."""
    return corners.where(unvignetted(layout, corners)[0])


def _rendered(
    layout: Layout, board: CalibrationBoard, folder: Path, *, frames: int, sensor: SensorName, seed: int
) -> tuple[Dataset, FloatArray, int]:
    """Render a set of tilted mirrors; return it, true pixels (frames, mirrors, corners, 2), and how many are visible.

    Vignetted corners are not counted: a calibration does not use them.
    """
    request = SetRequest(
        layout=layout,
        board=board,
        frames=frames,
        base_frames=0,
        seed=seed,
        tolerances=Tolerances(tilt_deg=TILT_DEG),
        settings=RenderSettings(renderer="fast", sensor=SENSORS[sensor], maps=False),
    )
    dataset: Dataset = render_set(request, folder)
    with np.load(folder / "truth" / "corners.npz") as truth:
        truth_px = truth["frames_px"]
        frame, view, corner = np.nonzero(truth["frames_visible"])
    built = Layout.load(folder / "truth" / "layout.json")
    visible = len(_used(built, Observations(frame, view, corner, truth_px[frame, view, corner])))
    return dataset, truth_px, visible


def stress(layout: Layout, folder: Path, *, sensor: SensorName, frames: int, seed: int) -> Iterator[tuple[str, Score]]:
    """Render a set into a folder, and yield the score under each of the `CONDITIONS`."""
    board = default_board()
    dataset, truth_px, visible = _rendered(layout, board, folder, frames=frames, sensor=sensor, seed=seed)
    built = Layout.load(folder / "truth" / "layout.json")
    pictures = [read_image(folder / name, grey=True) for name in dataset.frame_names]
    for number, condition in enumerate(CONDITIONS):
        random = np.random.default_rng([seed, number])
        disturbed = [degraded(picture, condition, random) for picture in pictures]
        found = detect_frames(disturbed, layout, board, mirrored=True, workers=cores())
        yield condition, score([_used(built, frame.corners) for frame in found], truth_px, visible)


BOARDS: dict[str, CalibrationBoard] = {
    "ChArUco": default_board(),
    "checkerboard": PLAIN,
    "AprilGrid, 10 x 7 tags": TAGS,
}


def speed(layout: Layout, name: str, board: CalibrationBoard, folder: Path, rows: Rows) -> float:
    """Return the processor time per frame, the minimum of several runs; add a row, or two for an AprilGrid."""
    dataset, truth_px, visible = _rendered(layout, board, folder, frames=TIMED_FRAMES, sensor="c920", seed=0)
    pictures = [read_image(folder / name, grey=True) for name in dataset.frame_names]
    found, shortest_s = [], []
    for picture in pictures:
        times = []
        for _ in range(RUNS):
            start_s = time.process_time()
            frame = detect_sub_images(picture, layout, board)
            times.append(time.process_time() - start_s)
        found.append(frame)
        shortest_s.append(min(times))
    if isinstance(board, Checkerboard):  # a frame alone may not number all of a checkerboard's corners
        found = number_jointly(found, [], layout, board)
    seconds = float(np.mean(shortest_s))
    _add(rows, name, seconds, score([frame.corners for frame in found], truth_px, visible))
    if isinstance(board, AprilGrid):
        start_s = time.process_time()
        corners_by_opencv = [tags_by_opencv(picture, layout, board) for picture in pictures]
        spent_s = (time.process_time() - start_s) / len(pictures)
        _add(rows, f"{name}, OpenCV", spent_s, score(corners_by_opencv, truth_px, visible))
    return seconds


def _add(rows: Rows, name: str, seconds: float, result: Score) -> None:
    rows.add(name, f"{seconds:.2f}", f"{result.found} of {result.visible}", f"{result.rms_px:.3f} px", f"{result.far}")


def tags_by_opencv(grey: Grey, layout: Layout, board: AprilGrid) -> Observations:
    """Return the corners of the tags that OpenCV reads in each mirror, within the nominal sub-images."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.markerBorderBits = TAG_BORDER
    detector = cv2.aruco.ArucoDetector(TAG_FAMILY, parameters)
    corner_index = {
        tuple(at): number for number, at in enumerate(np.round(board.corners_in_board_mm[:, :2], 6).tolist())
    }
    places = np.round(marker_corners(board) * board.pitch_mm, 6)
    width = grey.shape[1]
    parts = []
    for index in range(len(layout.mirrors)):
        mask = np.zeros(grey.shape, np.uint8)
        cv2.fillPoly(mask, [np.rint(layout.outline_px(index)).astype(np.int32)], 255)
        flipped = np.ascontiguousarray(np.where(mask > 0, grey, 0)[:, ::-1])
        quads, ids, _ = detector.detectMarkers(flipped)
        if ids is None:
            continue
        tags = [(int(number), quad) for number, quad in zip(ids.ravel(), quads, strict=True) if number < len(places)]
        if tags:
            quad_corners = np.concatenate([quad.reshape(4, 1, 2) for _, quad in tags])
            steps = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 40, 1e-3)
            pixels = (
                cv2.cornerSubPix(flipped, quad_corners, PEER_WINDOW, (-1, -1), steps).reshape(-1, 2).astype(np.float64)
            )
            pixels[:, 0] = width - 1 - pixels[:, 0]
            corner = np.array([corner_index[tuple(at)] for number, _ in tags for at in places[number].tolist()])
            parts.append(Observations.of_view(0, index, corner, pixels))
    return Observations.join(parts)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("layout", nargs="?", type=Path, default=DEFAULT_LAYOUT)
    parser.add_argument("--frames", type=int, default=20)
    add_json_option(parser)
    options = parser.parse_args()
    layout = Layout.load(options.layout)
    corners = false = 0
    sensors: tuple[SensorName, ...] = ("c920", "poor")
    rows = Rows("sensor", "condition", "found", "RMS", f"false: > {FALSE_PX:g} px", f"> {FALSE_SIGMAS:g} {SIGMA}")
    with TemporaryDirectory() as root:
        for seed, sensor in enumerate(sensors):
            folder = Path(root) / sensor
            for condition, found in stress(layout, folder, sensor=sensor, frames=options.frames, seed=seed):
                corners, false = corners + found.found, false + found.false
                detected = f"{found.found / found.visible:.0%} of {found.visible}"
                rows.add(sensor, condition, detected, f"{found.rms_px:.3f} px", f"{found.far}", f"{found.outlying}")
        print(f"false corners: {false} of {corners}, {1e4 * false / max(corners, 1):.2f} in 10,000 (limit 1)")
        write_record(options.json, "detection", {"corners": corners, "false": false}, rows.table)
        boards = Rows("board", "seconds a frame", "found", "RMS", f"beyond {FALSE_PX:g} px")
        slowest = max(speed(layout, name, board, Path(root) / board.kind, boards) for name, board in BOARDS.items())
        print(f"slowest board: {slowest:.2f} s a frame (limit {FRAME_LIMIT_S:g} s)")
        write_record(options.json, "detection_boards", table=boards.table)


if __name__ == "__main__":
    main()
