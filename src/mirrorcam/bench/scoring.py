"""Scores of calibrations of rendered sets, from files, and their results as files."""

from __future__ import annotations

import glob
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mirrorcam.bench.scores.calibration_score import CalibrationScore, score_calibration
from mirrorcam.bench.scores.figure_limits import Limits
from mirrorcam.bench.scores.matched_views import ViewsFile
from mirrorcam.bench.scores.report_texts import junit, markdown
from mirrorcam.bench.scores.score_report import NO_LIMITS, ScoredSet, ScoreReport, report_of, scored_set
from mirrorcam.bench.scores.stated_covariance import with_covariance
from mirrorcam.core.disk.output_folder import refuse_texts, write_texts
from mirrorcam.core.names import LONGEST
from mirrorcam.core.values import InputError, Value
from mirrorcam.optics.camera_files.camera_rig import CameraRig, PictureFlip
from mirrorcam.optics.camera_files.read.registry import FormatName, read_rig
from mirrorcam.optics.geometry.layout import Layout, working_distance_mm
from mirrorcam.render_scenes.sets.dataset import TRUE_LAYOUT, true_layout

SUSPECT_PX, FAR_BETTER = 5.0, 0.2
"""A worse score than the first is tried with pictures flipped otherwise; one better by the second factor is told."""
OTHERS: tuple[PictureFlip, ...] = ("left-right", "top-bottom", "as-is")


class ScoreRequest(Value):
    """What is scored, and how calibrations are read.

    Attributes
    ----------
    sets
        Folders of rendered sets, or of folders of sets.
    calibrations
        A file or folder for each set, or one folder that holds one for each, by the name of the set.
    covariances
        Files of covariances, in the same way; none where there are none.
    names
        Names of the sets in reports; none: those of their folders.
    format, unit, pictures, views, distance_mm, limits
        As the options of the command say.
    """

    sets: tuple[Path, ...]
    calibrations: tuple[Path, ...]
    covariances: tuple[Path, ...] = ()
    names: tuple[str, ...] = ()
    format: FormatName | None = None
    unit: str | None = None
    pictures: PictureFlip | None = None
    views: Path | None = None
    distance_mm: float | None = None
    limits: Path | None = None


@dataclass(frozen=True)
class ScoreFiles:
    """Where the report goes; None: nowhere."""

    json: Path | None = None
    markdown: Path | None = None
    junit: Path | None = None

    @property
    def paths(self) -> tuple[Path, ...]:
        """Those that are written."""
        return tuple(path for path in (self.json, self.markdown, self.junit) if path is not None)


def score(request: ScoreRequest) -> ScoreReport:
    """Score every set; raises InputError in one line where one cannot be."""
    folders = sets_in(request.sets)
    calibrations = for_each(request.calibrations, folders, "--calibration")
    covariances = for_each(request.covariances, folders, "--covariance") if request.covariances else ()
    names = _names(request.names, folders)
    views = None if request.views is None else ViewsFile.load(request.views)
    limits = NO_LIMITS if request.limits is None else Limits.load(request.limits)
    scored = [
        score_set(
            folder,
            calibration,
            request,
            name=names[place],
            covariance=covariances[place] if covariances else None,
            views=views,
            limits=limits,
        )
        for place, (folder, calibration) in enumerate(zip(folders, calibrations, strict=True))
    ]
    sets, scores = zip(*scored, strict=True)
    return report_of(sets, scores, limits)


def score_set(
    folder: Path,
    calibration: Path,
    request: ScoreRequest,
    *,
    name: str,
    covariance: Path | None,
    views: ViewsFile | None,
    limits: Limits,
) -> tuple[ScoredSet, CalibrationScore]:
    """Score one set, read as a request says; raises InputError in one line where it cannot be."""
    rig = read_rig(calibration, request.format, request.unit)
    if covariance is not None:
        rig = with_covariance(rig, covariance)
    truth = true_layout(folder)
    found = _score(folder, calibration, rig, truth, views, request)
    scored = scored_set(
        found,
        name=name,
        calibration=calibration.name[:LONGEST],
        format=rig.format,
        layout=truth.identity,
        limits=limits,
    )
    return scored, found


def _score(
    folder: Path, calibration: Path, rig: CameraRig, truth: Layout, views: ViewsFile | None, request: ScoreRequest
) -> CalibrationScore:
    nominal = Layout.load(folder / "layout.json")
    distance_mm = request.distance_mm or working_distance_mm(nominal)
    if distance_mm is None:
        raise InputError(f"{folder}: its layout tells no working distance, expected --distance-mm MM")

    def scored(pictures: PictureFlip | None) -> CalibrationScore:
        return score_calibration(rig, truth, nominal, distance_mm, views=views, pictures=pictures)

    try:
        found = scored(request.pictures)
    except InputError as error:
        raise InputError("; ".join([f"{calibration}: {error}", *_better_pictures(rig, scored, np.inf)])) from None
    rms_px = found.figures["rms_px"].value
    return replace(found, notes=(*found.notes, *_better_pictures(rig, scored, rms_px)))


def _better_pictures(
    rig: CameraRig, scored: Callable[[PictureFlip], CalibrationScore], rms_px: float
) -> tuple[str, ...]:
    """A line where pictures that were flipped otherwise make a bad score a good one; the file itself may say how."""
    if rig.pictures is not None or rms_px < SUSPECT_PX:
        return ()
    others = {}
    for pictures in OTHERS:
        with suppress(InputError):
            others[pictures] = scored(pictures).figures["rms_px"].value
    best = min(others, key=lambda pictures: others[pictures], default=None)
    if best is None or others[best] > FAR_BETTER * min(rms_px, SUSPECT_PX / FAR_BETTER):
        return ()
    return (f"with --pictures {best} it scores {others[best]:.3g} px RMS",)


def sets_in(paths: Sequence[Path]) -> tuple[Path, ...]:
    """The sets of some folders: these, or those in them; raises InputError where there is none with its truth."""
    found: list[Path] = []
    for path in paths:
        if not path.is_dir():
            raise InputError(f"{path}: no folder, expected a set that mirrorcam render wrote")
        inner = (
            [path]
            if (path / TRUE_LAYOUT).is_file()
            else sorted(each.parents[1] for each in path.glob(f"*/{TRUE_LAYOUT}"))
        )
        if not inner:
            raise InputError(
                f"{path}: no {TRUE_LAYOUT} in it or in a folder of it, expected a rendered set with its truth"
            )
        found += inner
    return tuple(found)


def for_each(given: Sequence[Path], folders: Sequence[Path], option: str) -> tuple[Path, ...]:
    """A file or folder for each set: one given for each, in order, or those of a folder, by the names of the sets."""
    if len(given) == len(folders):
        return tuple(given)
    if len(given) != 1 or not given[0].is_dir():
        raise InputError(f"{option}: {len(given)} for {len(folders)} sets, expected one for each, or a folder of them")
    found = []
    for folder in folders:
        name = folder.resolve().name
        fitting = [
            path for path in (given[0] / name, *sorted(given[0].glob(f"{glob.escape(name)}.*"))) if path.exists()
        ]
        if len(fitting) != 1:
            raise InputError(f"{given[0]}: {len(fitting)} files or folders named {name[:60]}, expected one for the set")
        found.append(fitting[0])
    return tuple(found)


def _names(given: Sequence[str], folders: Sequence[Path]) -> tuple[str, ...]:
    if given and len(given) != len(folders):
        raise InputError(f"--set-name: {len(given)} names for {len(folders)} sets, expected one for each")
    names = tuple(given) or tuple(folder.resolve().name[:LONGEST] for folder in folders)
    if not given and len(set(names)) < len(names):
        names = tuple("/".join(folder.resolve().parts[-2:])[-LONGEST:] for folder in folders)
    wrong = next((name for name in names if not name.isprintable() or not 1 <= len(name) <= LONGEST), None)
    if wrong is not None:
        raise InputError(f"set name {wrong[:40]!r}, expected 1 to {LONGEST} printable characters")
    if len(set(names)) < len(names):
        raise InputError("sets share a name, expected --set-name with different ones")
    return names


def write_report(report: ScoreReport, files: ScoreFiles, *, force: bool = False) -> None:
    """Write the files of a report, each atomically."""
    texts = {files.json: report.text(), files.markdown: markdown(report), files.junit: junit(report)}
    write_texts({path: text for path, text in texts.items() if path is not None}, "score", force=force)


def refuse_files(files: ScoreFiles, *, force: bool = False) -> None:
    """Raise InputError, before any work, where a file of a report would replace one of the user's, or another."""
    if len(set(files.paths)) < len(files.paths):
        raise InputError("--json, --markdown and --junit name one file twice, expected different ones")
    refuse_texts(files.paths, "score", force=force)
