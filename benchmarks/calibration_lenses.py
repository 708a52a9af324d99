"""Lenses beyond five numbers, found by evidence: `python -m benchmarks.calibration_lenses SET [SET ...]`.

Sets come from `python -m benchmarks.calibration_lenses layouts DIR`, which writes a layout for each lens, and
`mirrorcam render DIR/LENS.json --renderer fast --frames 20 --base-frames 10`. Each is calibrated from its
pictures and a layout whose camera is that of a data sheet, without distortion. Prints the level that evidence chose,
the rms residual, and

- held out: rms of every fifth frame, predicted by a calibration to the others, with only its poses fitted;
- floor: the same of the true camera and mirrors, which no calibration can be better than but by chance;
- bias: of corners without noise, where the calibration predicts them, with only poses fitted, minus where they are: the
  largest mean in a cell of 80 x 80 px.

Exits with 1 where held out is over the floor by more than 5 %, or a bias is above 0.01 px.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from benchmarks.records import Rows, add_json_option, write_record
from mirrorcam.core.disk.files import inside
from mirrorcam.core.processes.worker_pool import cores
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.calibration import calibrate
from mirrorcam.optics.calibration.corner_calibration import calibrate_corners
from mirrorcam.optics.calibration.diagnostics.requested_model import RequestedModel
from mirrorcam.optics.calibration.solver.levenberg_marquardt import Solution, fit
from mirrorcam.optics.calibration.solver.observations import Observations
from mirrorcam.optics.calibration.solver.parameterisation import Model
from mirrorcam.optics.calibration.solver.residuals import Board, Estimate, residuals
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.nearest_lens import with_lens
from mirrorcam.optics.geometry.targets import Target, load_board
from mirrorcam.render_scenes.sets.dataset import Dataset
from tests.optics.calibration.solver.scenes import nominal_layout

EVERY = 5
CELL_PX, LEAST_CORNERS = 80.0, 15
MOST_OVER_FLOOR, MOST_BIAS_PX = 1.05, 0.01
TANGENTIAL = (4e-4, -6e-4)


def lenses() -> dict[str, Camera]:
    """A C920 with a lens of each family."""
    plain = Camera.c920()
    curved = plain.replaced(distortion=[0.0, 0.0, *TANGENTIAL, 0.0])
    empty = with_lens(curved, "spline")
    field = 3e-4 * np.random.default_rng(0).standard_normal(len(empty.distortion) - 5)
    formulas = {
        "rational": ("rational", [1.2, 0.5, *TANGENTIAL, 0.1, 1.3, 0.9, 0.15]),
        "prism": ("thin_prism", [0.05, -0.12, *TANGENTIAL, 0.01, 0, 0, 0, 1.5e-3, -8e-4, -1e-3, 6e-4]),
        "fisheye": ("fisheye", [-0.02, 0.006, -0.004, 0.001]),
    }
    found = {name: plain.replaced(lens_model=model, distortion=numbers) for name, (model, numbers) in formulas.items()}
    return {"plain": plain} | found | {"spline": empty.replaced(distortion=np.append(curved.distortion, field))}


@dataclass(frozen=True)
class Figures:
    """What is printed of a set."""

    level: str
    rms_px: float
    held_out_px: float
    floor_px: float
    bias_px: float

    @property
    def passed(self) -> bool:
        return self.held_out_px <= MOST_OVER_FLOOR * self.floor_px and self.bias_px <= MOST_BIAS_PX


def measured(folder: Path) -> Figures:
    """The figures of a set."""
    dataset, board = Dataset.load(folder), load_board(folder / "board.toml")
    nominal = Layout.load(folder / "layout.json")
    sheet = nominal.camera.replaced(lens_model="brown_conrady", lens_grid=None, distortion=np.zeros(5))
    nominal = nominal.replaced(camera=sheet)
    frames, base = ([inside(folder, name) for name in names] for names in (dataset.frame_names, dataset.base_names))
    found = calibrate(frames, base, nominal, board, workers=cores())
    level = found.layout.provenance["level"]
    rows = found.observations.where(found.inliers)
    shown = [rows.where(rows.frame == number).shifted(-number) for number in np.unique(rows.frame)]
    mirrored = [each for each in shown if (each.view >= 0).any()]
    direct = [each for each in shown if (each.view < 0).all()]
    kept = [each for number, each in enumerate(mirrored) if number % EVERY < EVERY - 1]
    part = calibrate_corners(kept, direct, nominal, board.corners_in_board_mm, model=RequestedModel.parse(level))
    truth = Layout.load(folder / "truth" / "layout.json")
    out = [each for number, each in enumerate(mirrored) if number % EVERY == EVERY - 1]
    rest = Observations.join([each.shifted(number) for number, each in enumerate(out)])
    poses = found.rig_from_board[EVERY - 1 : len(mirrored) : EVERY]
    by_part, by_truth = (placed(layout, poses, rest, board) for layout in (part.layout, truth))
    both = by_part.inliers & by_truth.inliers
    return Figures(
        level,
        rms(found.residuals_px[found.inliers]),
        rms(by_part.residuals[both]),
        rms(by_truth.residuals[both]),
        largest_bias(found.layout, truth, rows, found.rig_from_board, board),
    )


def placed(layout: Layout, poses: FloatArray, rows: Observations, board: Target) -> Solution:
    """The fit of nothing but poses, (f, 4, 4) to start from, to what a layout shows."""
    start = Estimate.of(layout.camera, layout.mirrors, poses)
    corners = Board.rigid(board.corners_in_board_mm)
    return fit(start, rows, Model((), thickness=False, curvature=False, board=corners, mirrors=False))


def largest_bias(layout: Layout, truth: Layout, rows: Observations, poses: FloatArray, board: Target) -> float:
    """Largest mean difference in a cell between a layout and the truth, as they show the corners of all frames."""
    true = placed(truth, poses, rows, board).estimate
    exact = residuals(true, rows, Board.rigid(board.corners_in_board_mm)) + rows.pixels
    off = placed(layout, true.rig_from_board, replace(rows, pixels=exact), board).residuals
    cells, place = np.unique((rows.pixels // CELL_PX).astype(int), axis=0, return_inverse=True)
    count = np.bincount(place.ravel(), minlength=len(cells))
    means = np.array([np.bincount(place.ravel(), weights=each) for each in off.T]) / count
    return float(np.linalg.norm(means, axis=0)[count >= LEAST_CORNERS].max())


def rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def write_layouts(folder: Path) -> None:
    """A layout of nine mirrors for each lens."""
    nominal = nominal_layout()
    for name, camera in lenses().items():
        nominal.replaced(camera=camera).save(folder / f"{name}.json")


SHOWN = {"plain": "none", "prism": "thin prism", "spline": "spline, field of 0.4 px"}


def shown_as(folder: Path) -> tuple[str, str]:
    """The lens of a set, by the start of its folder's name up to a full stop, and renderer and numbers of frames."""
    dataset = Dataset.load(folder)
    lens = folder.name.partition(".")[0]
    counts = f"{len(dataset.frame_names)} + {len(dataset.base_names)}"
    return SHOWN.get(lens, lens), f"{dataset.settings.renderer}, {counts}"


def main(folders: list[Path], json: Path | None) -> int:
    rows = Rows("lens", "renderer, frames", "level found", "rms px", "held out px", "floor px", "ratio", "bias px")
    passed = True
    for folder in folders:
        found = measured(folder)
        passed &= found.passed
        ratio = found.held_out_px / found.floor_px
        figures = (f"{each:.4f}" for each in (found.rms_px, found.held_out_px, found.floor_px))
        bias = f"{found.bias_px:.4f}{'' if found.passed else ', past a limit'}"
        rows.add(*shown_as(folder), f"`{found.level}`", *figures, f"{ratio:.3f}", bias)
    write_record(json, "calibration_lenses", table=rows.table)
    return 0 if passed else 1


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sets", nargs="+", type=Path, metavar="SET", help="or `layouts DIR`")
    add_json_option(parser)
    options = parser.parse_args()
    if options.sets[0] == Path("layouts"):
        write_layouts(options.sets[1])
    else:
        sys.exit(main(options.sets, options.json))
