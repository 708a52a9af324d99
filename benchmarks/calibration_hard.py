"""Calibration from pictures that are hard: `python -m benchmarks.calibration_hard SET [SET ...]`.

A set is one of `benchmarks.calibration_foreign`. Its pictures are calibrated as they are, and with few of them, without
those of the bare camera, compressed, overexposed, blurred, of two sizes, and partly hidden. Prints for each case what
was refused and why, or the corners found and dropped, the worst normal against the truth, NEES per parameter and the
verdict.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.calibration_foreign import nees, worst_normal_deg
from benchmarks.detection_parts import hidden
from benchmarks.records import Rows, Table, add_json_option, table, write_record
from mirrorcam.core.images.pictures import pictures_in, read_image
from mirrorcam.core.processes.worker_pool import cores
from mirrorcam.core.values import InputError
from mirrorcam.optics.calibration.calibration import calibrate
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.diagnostics.verdict import STATES, check_solution
from mirrorcam.optics.calibration.diagnostics.view_statistics import view_figures
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.targets import load_board

JPEG_QUALITY = 25
GAIN = 1.8  # of an overexposed picture, which clips white
BLUR_PX = 2.5


@dataclass(frozen=True)
class Pictures:
    """Pictures through the mirrors and without them."""

    seen: Sequence[Grey]
    base: Sequence[Grey]

    def each(self, change: Callable[[Grey], Grey]) -> Pictures:
        """All of them changed."""
        return Pictures([change(grey) for grey in self.seen], [change(grey) for grey in self.base])


def compressed(grey: Grey) -> Grey:
    """As a strong JPEG."""
    _, coded = cv2.imencode(".jpg", grey, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return np.asarray(cv2.imdecode(coded, cv2.IMREAD_GRAYSCALE), dtype=np.uint8)


def overexposed(grey: Grey) -> Grey:
    """Brighter, so that white clips."""
    return np.asarray(np.clip(GAIN * grey.astype(np.float64), 0.0, 255.0), dtype=np.uint8)


def blurred(grey: Grey) -> Grey:
    """Out of focus."""
    return np.asarray(cv2.GaussianBlur(grey, (0, 0), BLUR_PX), dtype=np.uint8)


def of_two_sizes(pictures: Pictures) -> Pictures:
    """One of them at half the size."""
    return Pictures(
        [*pictures.seen[:-1], np.asarray(cv2.resize(pictures.seen[-1], None, fx=0.5, fy=0.5))], pictures.base
    )


def partly_hidden(pictures: Pictures, layout: Layout) -> Pictures:
    """With blobs and bars in front of the boards."""
    random = np.random.default_rng(0)
    seen = [hidden(hidden(grey, "ten blobs", layout, random), "five bars", layout, random) for grey in pictures.seen]
    return Pictures(seen, pictures.base)


def cases(pictures: Pictures, layout: Layout) -> dict[str, Pictures]:
    """All cases by what they are."""
    return {
        "as they are": pictures,
        "three frames, with base": Pictures(pictures.seen[:3], pictures.base),
        "no base": Pictures(pictures.seen, []),
        "three frames, no base": Pictures(pictures.seen[:3], []),
        f"JPEG {JPEG_QUALITY}": pictures.each(compressed),
        f"overexposed by {GAIN:g}": pictures.each(overexposed),
        f"blurred by {BLUR_PX:g} px": pictures.each(blurred),
        "one picture of half the size": of_two_sizes(pictures),
        "blobs and bars over the boards": partly_hidden(pictures, layout),
    }


def outcome(pictures: Pictures, folder: Path, layout: Layout, truth: dict[str, Any]) -> tuple[str, ...]:
    """What comes of one case: corners and how many were dropped, the worst normal, NEES, and the verdict."""
    try:
        found = calibrate(pictures.seen, pictures.base, layout, load_board(folder / "board.toml"), workers=cores())
    except InputError as error:
        return "", "", "", f"refused: {error}"
    verdict = check_solution(found, view_figures(found))
    return (
        f"{len(found.inliers):,}, {100.0 * np.mean(~found.inliers):.1f} %",
        f"{worst_normal_deg(found.layout, truth):.4f}°",
        f"{nees(found.layout, truth, lambda _: True):.1f}",
        f"{STATES[verdict.state]}{''.join(f': {reason}' for reason in verdict.reasons[:1])}",
    )


HEAD = ("corners, dropped", "worst normal", "NEES per parameter", "verdict")
OTHERS = {"a_cb": "checkerboard", "s2_ch": "acrylic"}
"""Sets of the second table."""


def beside(tables: dict[str, Table]) -> Table:
    """Tables of the same cases side by side."""
    columns = [each for name in tables for each in (f"{OTHERS[name]}: {HEAD[0]}", "worst normal", "NEES", "verdict")]
    rows = []
    for rows_of_case in zip(*(each.rows for each in tables.values()), strict=True):
        cells = [rows_of_case[0][0]]
        for _, *found, verdict in rows_of_case:
            cells += ["refused", "", "", ""] if verdict.startswith("refused") else [*found, verdict]
        rows.append(cells)
    return table(("", *columns), rows)


def main(folders: list[Path], record_to: Path | None) -> None:
    tables: dict[str, Table] = {}
    for folder in folders:
        layout = Layout.load(folder / "layout.json")
        truth = json.loads((folder / "truth" / "truth.json").read_text())
        seen, base = (
            [read_image(path, grey=True) for path in pictures_in([folder / name])] for name in ("frames", "base")
        )
        print(folder.name)
        rows = Rows("", *HEAD)
        for name, pictures in cases(Pictures(seen, base), layout).items():
            rows.add(name, *outcome(pictures, folder, layout, truth))
        tables[folder.name] = rows.table
    others = {name: each for name, each in tables.items() if name in OTHERS}
    for name, each in tables.items():
        if name not in others:
            write_record(record_to, f"calibration_hard_{name}", table=each)
    if others:
        write_record(record_to, "calibration_hard_others", table=beside(others))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sets", nargs="+", type=Path, metavar="SET")
    add_json_option(parser)
    options = parser.parse_args()
    main(options.sets, options.json)
