"""Score calibrations of rendered sets from files, and write the scores as files."""

from __future__ import annotations

import glob
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from mirrorcam import Layout
from mirrorcam.bench.score_request import Reading, ScoreRequest
from mirrorcam.bench.scores.calibration_score import CalibrationScore, score_calibration
from mirrorcam.bench.scores.consistency import with_covariance
from mirrorcam.bench.scores.matched_views import ViewsFile
from mirrorcam.bench.scores.report_texts import junit, markdown
from mirrorcam.bench.scores.score_report import NO_LIMITS, Limits, ScoredSet, ScoreReport, report_of, scored_set
from mirrorcam.core.disk.files import write_text
from mirrorcam.core.errors import InputError
from mirrorcam.core.names import LONGEST
from mirrorcam.optics.camera_files.camera_rig import CameraRig, PictureFlip
from mirrorcam.optics.camera_files.read.registry import read_rig
from mirrorcam.optics.geometry.layout import working_distance_mm
from mirrorcam.render_scenes.sets.dataset import TRUE_LAYOUT, true_layout, true_lens

FILES = ("score.json", "score.md", "junit.xml")
"""Names of the files of a report."""
SUSPECT_PX, MUCH_BETTER = 5.0, 0.2
"""RMS errors above the first are repeated with other flips; a reduction to less than the second factor is reported."""
OTHER_FLIPS: tuple[PictureFlip, ...] = ("left-right", "top-bottom", "as-is")


def score(sets: Sequence[Path], request: ScoreRequest, reading: Reading) -> ScoreReport:
    """Score the calibrations of sets, or of folders of sets; raises InputError if one cannot be scored."""
    folders = sets_in(sets)
    calibrations = files_by_set(request.calibration, folders, "--calibration")
    given_covariances = files_by_set(request.covariance, folders, "--covariance") if request.covariance else ()
    covariances = given_covariances or (None,) * len(folders)
    names = _names(folders)
    views = None if reading.views is None else ViewsFile.load(reading.views)
    limits = NO_LIMITS if reading.limits is None else Limits.load(reading.limits)
    scored = [
        score_set(
            folder,
            calibration,
            reading,
            name=name,
            covariance=covariance,
            views=views,
            limits=limits,
            distance_mm=request.distance_mm,
        )
        for folder, calibration, covariance, name in zip(folders, calibrations, covariances, names, strict=True)
    ]
    scored_sets, scores = zip(*scored, strict=True)
    return report_of(scored_sets, scores, limits)


def score_set(
    folder: Path,
    calibration: Path,
    reading: Reading,
    *,
    name: str,
    covariance: Path | None,
    views: ViewsFile | None,
    limits: Limits,
    distance_mm: float | None = None,
) -> tuple[ScoredSet, CalibrationScore]:
    """Score one set at a working distance, by default its layout's; raises InputError if it cannot be scored."""
    rig = read_rig(calibration, reading.format, reading.unit)
    if covariance is not None:
        rig = with_covariance(rig, covariance)
    truth, nominal, lens = true_layout(folder), Layout.load(folder / "layout.json"), true_lens(folder)
    distance_mm = distance_mm or working_distance_mm(nominal)
    if distance_mm is None:
        raise InputError(f"{folder}: its layout states no working distance, expected --distance-mm MM")
    lateral_colour = lens is not None and lens.grey_magnification != 1.0
    result = _score(calibration, rig, truth, nominal, distance_mm, views, reading.flip, lateral_colour=lateral_colour)
    scored = scored_set(
        result,
        name=name,
        calibration=calibration.name[:LONGEST],
        format=rig.format,
        layout=truth.identity,
        limits=limits,
    )
    return scored, result


def _score(
    calibration: Path,
    rig: CameraRig,
    truth: Layout,
    nominal: Layout,
    distance_mm: float,
    views: ViewsFile | None,
    flip: PictureFlip | None,
    *,
    lateral_colour: bool,
) -> CalibrationScore:
    def score_with(pictures: PictureFlip | None) -> CalibrationScore:
        return score_calibration(
            rig, truth, nominal, distance_mm, views=views, pictures=pictures, lateral_colour=lateral_colour
        )

    try:
        result = score_with(flip)
    except InputError as error:
        raise InputError("; ".join([f"{calibration}: {error}", *_better_flip(rig, score_with, np.inf)])) from None
    rms_px = result.figures["rms_px"].value
    return replace(result, notes=(*result.notes, *_better_flip(rig, score_with, rms_px)))


def _better_flip(
    rig: CameraRig, score_with: Callable[[PictureFlip], CalibrationScore], rms_px: float
) -> tuple[str, ...]:
    """Return a note if another flip of the pictures improves a bad score greatly, unless the file states the flip."""
    if rig.pictures is not None or rms_px < SUSPECT_PX:
        return ()
    others = {}
    for pictures in OTHER_FLIPS:
        with suppress(InputError):
            others[pictures] = score_with(pictures).figures["rms_px"].value
    best = min(others, key=lambda pictures: others[pictures], default=None)
    if best is None or others[best] > MUCH_BETTER * min(rms_px, SUSPECT_PX / MUCH_BETTER):
        return ()
    return (f"with --flip {best} it scores {others[best]:.3g} px RMS",)


def sets_in(paths: Sequence[Path]) -> tuple[Path, ...]:
    """Return the sets among folders and their subfolders; raises InputError for a folder without a rendered set."""
    folders: list[Path] = []
    for path in paths:
        if not path.is_dir():
            raise InputError(f"{path}: is not a folder, expected a set that mirrorcam render wrote")
        inside = (
            [path]
            if (path / TRUE_LAYOUT).is_file()
            else sorted(truth.parents[1] for truth in path.glob(f"*/{TRUE_LAYOUT}"))
        )
        if not inside:
            raise InputError(
                f"{path}: no {TRUE_LAYOUT} in it or its subfolders, expected a rendered set with its ground truth"
            )
        folders += inside
    return tuple(folders)


def files_by_set(given: Sequence[Path], folders: Sequence[Path], option: str) -> tuple[Path, ...]:
    """Return the file of each set: listed in order, or found in one folder by the names of the sets."""
    if len(given) == len(folders):
        return tuple(given)
    if len(given) != 1 or not given[0].is_dir():
        raise InputError(
            f"{option}: {len(given)} for {len(folders)} sets, expected one for each set, or a folder of them"
        )
    files = []
    for folder in folders:
        name = folder.resolve().name
        matches = [
            path for path in (given[0] / name, *sorted(given[0].glob(f"{glob.escape(name)}.*"))) if path.exists()
        ]
        if len(matches) != 1:
            raise InputError(f"{given[0]}: {len(matches)} files or folders named {name[:60]}, expected one for the set")
        files.append(matches[0])
    return tuple(files)


def _names(folders: Sequence[Path]) -> tuple[str, ...]:
    """Return the names of sets in reports: their folders' names, with the parent folder if two are equal."""
    names = tuple(folder.resolve().name[:LONGEST] for folder in folders)
    if len(set(names)) < len(names):
        names = tuple("/".join(folder.resolve().parts[-2:])[-LONGEST:] for folder in folders)
    invalid = next((name for name in names if not name.isprintable() or not name), None)
    if invalid is not None:
        raise InputError(f"set name {invalid[:40]!r}, expected 1 to {LONGEST} printable characters")
    if len(set(names)) < len(names):
        raise InputError("sets share a name, expected folders of different names")
    return names


def write_report(report: ScoreReport, folder: Path) -> None:
    """Write the files of a report into a folder, each atomically."""
    for name, text in zip(FILES, (report.text(), markdown(report), junit(report)), strict=True):
        write_text(folder / name, text)
