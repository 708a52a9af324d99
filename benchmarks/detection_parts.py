"""Detection of partly hidden checkerboards: `python -m benchmarks.detection_parts SET`.

SET is a folder with `frames/`, `base/`, `layout.json`, `board.toml` and `truth/truth.json`, which holds the true camera
(K, D), virtual centres (C) and poses of the board. Prints the numbers of frames, views and corners detected in the
unchanged pictures, and with blobs, with bars, and with all but the centre of each sub-image covered; and the number of
wrong corners: those more than 1 px from their true positions.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import cv2
import numpy as np

from benchmarks.records import Rows, add_json_option, write_record
from mirrorcam.core.images.pictures import pictures_in, read_image
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.detection.detect_boards import detect_frames
from mirrorcam.optics.calibration.detection.joint_numbering import number_jointly
from mirrorcam.optics.geometry.boards import Checkerboard, load_board
from mirrorcam.optics.geometry.layout import Layout

WAYS = {
    "nothing more": "9, 22, 2304",
    "ten blobs": "5, 7, 735",
    "five bars": "5, 7, 720",
    "all but the middle of each view": "0",
}
"""Ways of hiding parts, and the frames, views and corners detected in set `a_cb` when only complete boards were."""
BLOBS, BARS = 10, 5
WRONG_PX = 1.0
OUTER_MARGIN, INNER_MARGIN = 0.12, 0.04  # of the height, around the middle of each sub-image


def hidden(grey: Grey, way: str, layout: Layout, random: np.random.Generator) -> Grey:
    """Return a picture with parts hidden in one of the `WAYS`."""
    height, width = grey.shape
    covered = grey.copy()
    if way == "ten blobs":
        for _ in range(BLOBS):
            centre, axes = random.integers(0, [width, height]), random.integers(25, 70, 2)
            angle_deg, level = float(random.uniform(0.0, 180.0)), int(random.integers(30, 235))
            cv2.ellipse(covered, centre.tolist(), axes.tolist(), angle_deg, 0.0, 360.0, (level,), -1)
    if way == "five bars":
        for _ in range(BARS):
            centre, angle = random.integers(0, [width, height]), random.uniform(0.0, np.pi)
            half_line = np.array([np.cos(angle), np.sin(angle)]) * (width + height)
            ends = [(centre + sign * half_line).astype(int).tolist() for sign in (-1, 1)]
            cv2.line(covered, ends[0], ends[1], (int(random.integers(30, 235)),), int(random.integers(10, 50)))
    if way == "all but the middle of each view":
        covered[:] = 40
        rows, cols = layout.rows, layout.cols
        far, near = int(OUTER_MARGIN * height), int(INNER_MARGIN * height)
        for row in range(rows):
            for col in range(cols):
                part = np.s_[
                    row * height // rows + far : (row + 1) * height // rows - near,
                    col * width // cols + far : (col + 1) * width // cols - far,
                ]
                covered[part] = grey[part]
    return covered


def true_pixels(folder: Path, points: FloatArray) -> FloatArray:
    """Return the pixels (frames, mirrors, c, 2) of a board's points (c, 3) in each mirror."""
    truth = json.loads((folder / "truth" / "truth.json").read_text())
    fx, fy, cx, cy = truth["K"]
    matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    frames = []
    for pose in np.array(truth["poses"]):
        in_rig = points @ pose[:3, :3].T + pose[:3, 3]
        images = [in_rig - 2.0 * (in_rig @ c / (c @ c) - 0.5)[:, None] * c for c in np.array(truth["C"])]
        views = [cv2.projectPoints(each, np.zeros(3), np.zeros(3), matrix, np.array(truth["D"]))[0] for each in images]
        frames.append(np.array(views)[:, :, 0])
    return np.array(frames)


def main(folder: Path, record_to: Path | None) -> None:
    layout, board = Layout.load(folder / "layout.json"), load_board(folder / "board.toml")
    if not isinstance(board, Checkerboard):
        raise SystemExit(f"{folder / 'board.toml'}: expected a checkerboard")
    truth_px = true_pixels(folder, board.corners_in_board_mm)
    pictures, others = (
        [read_image(path, grey=True) for path in pictures_in([folder / name])] for name in ("frames", "base")
    )
    base = detect_frames(others, layout, board, mirrored=False)
    rows = Rows("hidden by", "before: frames, views, corners", "each frame alone", "all frames together", "wrong")
    for way, before in WAYS.items():
        random = np.random.default_rng(0)
        alone = detect_frames(
            [hidden(picture, way, layout, random) for picture in pictures], layout, board, mirrored=True
        )
        cells, wrong = [], 0
        for found in (alone, number_jointly(alone, base, layout, board)):
            corners = [frame.corners for frame in found]
            errors = [np.linalg.norm(o.pixels - truth_px[n][o.view, o.corner], axis=1) for n, o in enumerate(corners)]
            frames, views = sum(len(o) > 0 for o in corners), sum(len(np.unique(o.view)) for o in corners)
            wrong = max(wrong, int((np.concatenate(errors) > WRONG_PX).sum()))
            cells.append(f"{frames}, {views}, {sum(map(len, corners))}")
        rows.add(way, before, *cells, f"{wrong}")
    write_record(record_to, "detection_parts", table=rows.table)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="SET")
    add_json_option(parser)
    options = parser.parse_args()
    main(options.folder, options.json)
