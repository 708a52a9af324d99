"""Mirrors that moved, told from any scene: `python -m benchmarks.drift [--recordings N] [SET ...]`.

Simulated recordings of a calibrated device of nine mirrors (960 x 540 px; the calibration is from noisy corners, so
that its errors are real ones): five frames each of a random scene of nine textured sheets, at random depths, with
noise, blur, JPEG, and for half of them a moving scene and a rolling shutter. Pictures of a folder given by --pictures
serve as textures beside random ones. Each recording is tested as it is, and against layouts in which one mirror is
turned by .005, .01, .02 and .05 deg.

A SET is a folder as for `benchmarks.calibration_foreign`: it is calibrated, and groups of five of its frames are tested
in the same ways.

Prints for each turn: recordings in which an alarm was raised, in which only the right mirror was named, the error of
the re-solved turn, and the square of it over what its covariance says, per degree of freedom; for unmoved ones the
largest statistics relative to the threshold (1 is an alarm), and where an exponential tail fitted to their upper
quarter is exceeded once in 10,000.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.records import Rows, Table, add_json_option, table, write_record
from mirrorcam.calibration.calibration_files import CalibrationRequest, calibrate_files
from mirrorcam.core.images.pictures import pictures_in, read_image
from mirrorcam.optics.drift.drift import Drift, find_drift
from mirrorcam.optics.drift.matched_points import MatchedPoints, PointMatcher
from mirrorcam.optics.geometry.layout import Layout
from tests.optics.drift.calibrated_device import across, device, turned
from tests.optics.drift.textured_scenes import Picture, Sheet, Shot, fractal, photograph, scene

TURNS_DEG = (0.0, 0.005, 0.01, 0.02, 0.05)
FRAMES = 5
ONE_IN = 10_000


@dataclass(frozen=True)
class Outcome:
    """What one test of one recording gave."""

    turn_deg: float
    statistic: float
    alarm: bool
    only_right: bool
    error_deg: float
    nees: float
    told: bool
    seconds: float


def outcomes(
    layout: Layout, frames: list[Any], random: np.random.Generator, turns_deg: tuple[float, ...] = TURNS_DEG
) -> Iterator[Outcome]:
    """Test frames against the layout with a mirror turned by each of some angles; by 0: as it is."""
    index = int(random.integers(len(layout.mirrors)))
    axis = across(layout, index, 1.0, random)
    for size in turns_deg:
        against = turned(layout, index, size * axis) if size else layout
        start = time.perf_counter()
        matcher = PointMatcher(against)
        found = find_drift(against, MatchedPoints.joined([matcher.match(frame) for frame in frames]))
        yield _outcome(found, index, -size * axis, size, time.perf_counter() - start)


def _outcome(found: Drift, index: int, turn_deg: Any, size: float, seconds: float) -> Outcome:
    move = found.mirrors[index]
    error = float(np.linalg.norm(move.turn_deg - turn_deg))
    return Outcome(
        turn_deg=size,
        statistic=max(mirror.statistic for mirror in found.mirrors),
        alarm=bool(found.moved),
        only_right=[mirror.index for mirror in found.moved] == [index],
        error_deg=error,
        nees=(error / move.turn_sigma_deg) ** 2 / 2.0,
        told=not found.untold,
        seconds=seconds / FRAMES,
    )


def simulated(pictures: list[Picture], turns_deg: tuple[float, ...], seed: int) -> list[Outcome]:
    """One recording of the simulated device."""
    random, made = np.random.default_rng(seed), device()
    textures = [fractal(random, slope=slope) for slope in (0.8, 1.2, 1.6)] + pictures
    depths = (random.uniform(200.0, 300.0), random.uniform(400.0, 900.0))
    sheets = scene(random, depths, textures, made.truth.camera.fx_px)
    step = random.normal(0.0, 6.0, 3) if seed % 2 else np.zeros(3)
    frames = []
    for number in range(FRAMES):
        shot = Shot(
            noise=random.uniform(0.5, 3.0),
            jpeg=int(random.choice([0, 95, 85])),
            blur_px=random.uniform(0.5, 1.2),
            shift_mm=tuple(random.normal(0.0, 3.0, 3) if seed % 2 else np.zeros(3)),
            turn_rad=tuple(random.normal(0.0, 0.008, 3) if seed % 2 else np.zeros(3)),
        )
        now = [Sheet(sheet.middle + number * step, sheet.axes, sheet.picture, sheet.texel_mm) for sheet in sheets]
        frames.append(photograph(made.truth, now, shot, random))
    return list(outcomes(made.calibrated, frames, random, turns_deg))


def of_set(folder: Path) -> list[Outcome]:
    """Groups of five frames of a set of another renderer, with its calibration by all its frames."""
    with tempfile.TemporaryDirectory() as kept:
        request = CalibrationRequest(
            pictures=(folder / "frames",),
            board=folder / "board.toml",
            layout=folder / "layout.json",
            base_pictures=(folder / "base",),
            detections=Path(kept),
        )
        layout = calibrate_files(request).layout
    random = np.random.default_rng(0)
    found: list[Outcome] = []
    paths = pictures_in([folder / "frames"])
    for _ in range(4):
        order = random.permutation(len(paths)).tolist()
        for start in range(0, len(order) - FRAMES + 1, FRAMES):
            frames = [read_image(paths[number]) for number in order[start : start + FRAMES]]
            found += outcomes(layout, frames, random)
    return found


@dataclass(frozen=True)
class Report:
    """A column of the table, the largest statistic of unmoved recordings, its tail, and scenes with enough texture."""

    cells: tuple[str, ...]
    largest: float
    tail: float
    told: int


def column(found: list[Outcome]) -> tuple[str, ...]:
    """For each turn the alarms and the largest error where there was one; then the range of the NEES."""
    cells, ratios = [], []
    for size in TURNS_DEG:
        some = [each for each in found if each.turn_deg == size]
        alarms = [each for each in some if each.alarm]
        wrong = sum(not each.only_right for each in alarms) if size else 0
        errors = f"; {max(each.error_deg for each in alarms):.3f}°" if alarms and size else ""
        cells.append(f"{len(alarms)}{errors}{f'; {wrong} of a wrong mirror' if wrong else ''}")
        ratios += [float(np.mean([each.nees for each in some]))] if size else []
    return *cells, f"{min(ratios):.1f} to {max(ratios):.1f}"


def report(title: str, found: list[Outcome]) -> Report:
    """Print the table of a kind of recordings, and return its figures."""
    count = sum(each.turn_deg == 0.0 for each in found)
    print(f"{title}: {count} recordings, {np.median([each.seconds for each in found]):.2f} s a frame")
    rows = Rows("turn", "alarms", "of the right mirror alone", "error, median", "largest", "NEES")
    for size in sorted({each.turn_deg for each in found}):
        some = [each for each in found if each.turn_deg == size]
        errors = [each.error_deg for each in some]
        only = "" if size == 0.0 else str(sum(each.only_right for each in some))
        degrees = f"{statistics.median(errors):.4f}°", f"{max(errors):.4f}°"
        nees = f"{np.mean([each.nees for each in some]):.2f}"
        rows.add(f"{size:g}°", f"{sum(each.alarm for each in some)} of {len(some)}", only, *degrees, nees)
    still = np.sort([each.statistic for each in found if each.turn_deg == 0.0])
    high = float(np.quantile(still, 0.75))
    tail = high + float(np.mean(still[still > high]) - high) * np.log(0.25 * ONE_IN)
    largest = ", ".join(f"{value:.2f}" for value in still[-4:])
    told = sum(each.told for each in found if each.turn_deg == 0.0)
    print(f"  unmoved: largest statistics {largest}; one in {ONE_IN} by an exponential tail: {tail:.2f}")
    print(f"  texture enough to tell turns of .02 deg of all mirrors in {told} of {count}")
    moved = any(each.turn_deg for each in found)
    return Report(column(found) if moved else (), float(still[-1]), tail, told)


def recorded(reports: dict[str, Report]) -> tuple[dict[str, float], Table]:
    """Figures and table of simulated recordings, which come first, and of sets."""
    simulation, *sets = reports.values()
    figures = {
        "largest_simulated": simulation.largest,
        "largest_of_sets": max(each.largest for each in sets),
        "exponential_tail": simulation.tail,
        "told_scenes": simulation.told,
    }
    titles = ["none", *(f"{size:g}°" for size in TURNS_DEG[1:]), "NEES of the turn, per degree of freedom"]
    rows = zip(titles, *(each.cells for each in reports.values()), strict=True)
    return figures, table(("turn", *reports), rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sets", nargs="*", type=Path, metavar="SET")
    parser.add_argument("--recordings", type=int, default=100)
    parser.add_argument("--first", type=int, default=0, metavar="SEED")
    parser.add_argument("--unmoved", action="store_true", help="simulated recordings only as they are")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--pictures", type=Path, help="folder of pictures that serve as textures")
    add_json_option(parser)
    given = parser.parse_args()
    files = pictures_in([given.pictures]) if given.pictures else []
    pictures = [(read_image(file, grey=True) / 255.0).astype(np.float32) for file in files]
    reports: dict[str, Report] = {}
    if given.recordings:
        device()
        with ProcessPoolExecutor(given.workers) as pool:
            seeds = range(given.first, given.first + given.recordings)
            turns = (0.0,) if given.unmoved else TURNS_DEG
            found = [each for some in pool.map(partial(simulated, pictures, turns), seeds) for each in some]
        reports[f"simulated, of {given.recordings}"] = report("simulated", found)
    for folder in given.sets:
        tested = of_set(folder)
        count = sum(each.turn_deg == 0.0 for each in tested)
        reports[f"`{folder.name}`, of {count}"] = report(folder.name, tested)
    if given.json and given.recordings and given.sets and not given.unmoved:
        write_record(given.json, "drift", *recorded(reports))


if __name__ == "__main__":
    main()
