"""Detection under stress, and its speed beside OpenCV: `python -m benchmarks.detection [LAYOUT] [--json FILE]`.

Frames of mirrors that are tilted by 2 degrees (sigma) are rendered for a good and for a poor camera, each as it is and
with glare, motion blur, little light, strong compression, and all of these at once. Printed for each: the share of the
visible corners that is found, their error, and the number of false ones: more than 1 px, or 5 of their own standard
deviations (scaled to the errors of that mirror's corners in that run, and at least 0.1 px), from the true place.

Then the processor time of a frame of nine views at 1920 x 1080 (limit: 0.5 s) for each kind of board. AprilGrids are
also searched by OpenCV, in the flipped part of the frame that each mirror is known to fill, with `cornerSubPix`.
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
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.targets import TAG_BORDER, TAG_FAMILY, AprilGrid, Checkerboard, Target, default_board
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
    """A frame with one of the `CONDITIONS`."""
    light = grey.astype(np.float32)
    everything = condition == "all at once"
    if condition == "motion blur" or everything:
        length, angle = random.uniform(2.0, 5.0), random.uniform(0.0, np.pi)
        kernel = np.zeros((15, 15), np.float32)
        for step in np.linspace(-length / 2.0, length / 2.0, 41):
            x, y = 7.0 + step * np.cos(angle), 7.0 + step * np.sin(angle)
            column, row, right, down = int(x), int(y), x % 1.0, y % 1.0
            kernel[row : row + 2, column : column + 2] += np.outer([1.0 - down, down], [1.0 - right, right])
        light = np.asarray(cv2.filter2D(light, -1, kernel / kernel.sum()), dtype=np.float32)
    if condition == "glare" or everything:
        y, x = np.mgrid[: grey.shape[0], : grey.shape[1]].astype(np.float32)
        for _ in range(6):
            u, v, size = random.uniform(0, grey.shape[1]), random.uniform(0, grey.shape[0]), random.uniform(15, 70)
            light += random.uniform(100, 900) * np.exp(-((x - u) ** 2 + (y - v) ** 2) / np.float32(2.0 * size**2))
    if condition == "dim" or everything:
        light = np.clip(light, 0, 255) * (0.5 if everything else 0.25)
        light += random.normal(0.0, 1.5, grey.shape).astype(np.float32)
    picture = np.clip(np.rint(light), 0, 255).astype(np.uint8)
    if condition == "JPEG 40" or everything:
        encoded = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 40])[1]
        picture = np.asarray(cv2.imdecode(encoded, cv2.IMREAD_GRAYSCALE), dtype=np.uint8)
    return picture


@dataclass(frozen=True)
class Score:
    """Detection score of some frames.

    `visible` and `found` are numbers of corners, `rms_px` is the error per axis of those within `FALSE_PX`; `far` is
    the number beyond it, `outlying` the number beyond `FALSE_SIGMAS` of their standard deviations.
    """

    visible: int
    found: int
    rms_px: float
    far: int
    outlying: int

    @property
    def false(self) -> int:
        return max(self.far, self.outlying)


def score(seen: list[Observations], truth_px: FloatArray, visible: int) -> Score:
    """Corners against pixels (frames, mirrors, corners, 2)."""
    off = np.concatenate([o.pixels - truth_px[frame][o.view, o.corner] for frame, o in enumerate(seen)])
    views, stated = (np.concatenate([getattr(o, name) for o in seen]) for name in ("view", "sigma_px"))
    distance = np.linalg.norm(off, axis=1)
    far = ~(distance <= FALSE_PX)
    near = off[~far]
    outlying = far.copy()
    for view in np.unique(views):
        # Each mirror has its own light and sharpness. Rayleigh's median is 1.177 sigma; a few outliers do not move it.
        shown = views == view
        scale = float(np.median(distance[shown] / stated[shown])) / 1.1774
        limit = np.maximum(FALSE_SIGMAS * scale * stated[shown], MIN_FALSE_PX)
        outlying[shown] |= (np.abs(off[shown]) > limit[:, None]).any(axis=1)
    rms = float(np.sqrt(np.mean(near**2))) if len(near) else float("nan")
    return Score(visible, len(off), rms, int(far.sum()), int(outlying.sum()))


def _used(layout: Layout, corners: Observations) -> Observations:
    """The corners that a calibration uses."""
    return corners.where(unvignetted(layout, corners)[0])


def _rendered(
    layout: Layout, target: Target, folder: Path, *, frames: int, sensor: SensorName, seed: int
) -> tuple[Dataset, FloatArray, int]:
    """A set of tilted mirrors rendered into a folder, true pixels (frame, mirror, corner, 2), and how many are visible.

    Corners that only a part of the pupil sees are not counted: a calibration leaves them out.
    """
    request = SetRequest(
        layout=layout,
        target=target,
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
    """The score of each of the `CONDITIONS`, of a set that is rendered into a folder."""
    target = default_board()
    dataset, truth_px, visible = _rendered(layout, target, folder, frames=frames, sensor=sensor, seed=seed)
    built = Layout.load(folder / "truth" / "layout.json")
    pictures = [read_image(folder / name, grey=True) for name in dataset.frame_names]
    for number, condition in enumerate(CONDITIONS):
        random = np.random.default_rng([seed, number])
        bad = [degraded(picture, condition, random) for picture in pictures]
        found = detect_frames(bad, layout, target, mirrored=True, workers=cores())
        yield condition, score([_used(built, frame.corners) for frame in found], truth_px, visible)


BOARDS: dict[str, Target] = {"ChArUco": default_board(), "checkerboard": PLAIN, "AprilGrid, 10 x 7 tags": TAGS}


def speed(layout: Layout, name: str, target: Target, folder: Path, rows: Rows) -> float:
    """Processor time of a frame, the least of a few runs; adds a row, and for an AprilGrid one of OpenCV's tags."""
    dataset, truth_px, visible = _rendered(layout, target, folder, frames=TIMED_FRAMES, sensor="c920", seed=0)
    pictures = [read_image(folder / name, grey=True) for name in dataset.frame_names]
    found, least = [], []
    for picture in pictures:
        spent = []
        for _ in range(RUNS):
            started = time.process_time()
            frame = detect_sub_images(picture, layout, target)
            spent.append(time.process_time() - started)
        found.append(frame)
        least.append(min(spent))
    if isinstance(target, Checkerboard):  # a frame alone may not number all of a checkerboard's corners
        found = number_jointly(found, [], layout, target)
    seconds = float(np.mean(least))
    _add(rows, name, seconds, score([frame.corners for frame in found], truth_px, visible))
    if isinstance(target, AprilGrid):
        started = time.process_time()
        theirs = [tags_by_opencv(picture, layout, target) for picture in pictures]
        spent_s = (time.process_time() - started) / len(pictures)
        _add(rows, f"{name}, OpenCV", spent_s, score(theirs, truth_px, visible))
    return seconds


def _add(rows: Rows, name: str, seconds: float, seen: Score) -> None:
    rows.add(name, f"{seconds:.2f}", f"{seen.found} of {seen.visible}", f"{seen.rms_px:.3f} px", f"{seen.far}")


def tags_by_opencv(grey: Grey, layout: Layout, target: AprilGrid) -> Observations:
    """Corners of the tags that OpenCV reads in each mirror, with the sub-images as given."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.markerBorderBits = TAG_BORDER
    detector = cv2.aruco.ArucoDetector(TAG_FAMILY, parameters)
    corner_at = {tuple(at): number for number, at in enumerate(np.round(target.corners_in_board_mm[:, :2], 6).tolist())}
    places = np.round(marker_corners(target) * target.pitch_mm, 6)
    width = grey.shape[1]
    parts = []
    for index in range(len(layout.mirrors)):
        mask = np.zeros(grey.shape, np.uint8)
        cv2.fillPoly(mask, [np.rint(layout.outline_px(index)).astype(np.int32)], 255)
        flipped = np.ascontiguousarray(np.where(mask > 0, grey, 0)[:, ::-1])
        quads, ids, _ = detector.detectMarkers(flipped)
        if ids is None:
            continue
        known = [(int(number), quad) for number, quad in zip(ids.ravel(), quads, strict=True) if number < len(places)]
        if known:
            seen = np.concatenate([quad.reshape(4, 1, 2) for _, quad in known])
            steps = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 40, 1e-3)
            pixels = cv2.cornerSubPix(flipped, seen, PEER_WINDOW, (-1, -1), steps).reshape(-1, 2).astype(np.float64)
            pixels[:, 0] = width - 1 - pixels[:, 0]
            named = np.array([corner_at[tuple(at)] for number, _ in known for at in places[number].tolist()])
            parts.append(Observations.of_view(0, index, named, pixels))
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
    with TemporaryDirectory() as place:
        for seed, sensor in enumerate(sensors):
            folder = Path(place) / sensor
            for condition, found in stress(layout, folder, sensor=sensor, frames=options.frames, seed=seed):
                corners, false = corners + found.found, false + found.false
                share = f"{found.found / found.visible:.0%} of {found.visible}"
                rows.add(sensor, condition, share, f"{found.rms_px:.3f} px", f"{found.far}", f"{found.outlying}")
        print(f"false corners: {false} of {corners}, {1e4 * false / max(corners, 1):.2f} in 10,000 (limit 1)")
        write_record(options.json, "detection", {"corners": corners, "false": false}, rows.table)
        boards = Rows("board", "seconds a frame", "found", "RMS", f"beyond {FALSE_PX:g} px")
        slowest = max(speed(layout, name, target, Path(place) / target.kind, boards) for name, target in BOARDS.items())
        print(f"slowest board: {slowest:.2f} s a frame (limit {FRAME_LIMIT_S:g} s)")
        write_record(options.json, "detection_boards", table=boards.table)


if __name__ == "__main__":
    main()
