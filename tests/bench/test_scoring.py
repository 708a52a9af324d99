"""Scores from folders: which calibration is of which set, covariances, hints, and files that are not replaced."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from mirrorcam.bench.score_request import Reading, ScoreRequest
from mirrorcam.bench.scoring import FILES, score, sets_in, write_report
from mirrorcam.core.errors import InputError
from mirrorcam.optics.camera_files.write import write_exports
from tests.optics.camera_files.rigs import device


def make_set(folder: Path) -> Path:
    """What a score needs of a rendered set: no pictures."""
    device().nominal.save(folder / "layout.json")
    device().truth.save(folder / "truth" / "layout.json")
    return folder


@pytest.fixture(scope="module")
def exports(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("exports")
    write_exports(device().truth, folder)
    return folder


@pytest.fixture(scope="module")
def one(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_set(tmp_path_factory.mktemp("one") / "indoor")


def test_a_set_is_scored_at_the_distance_of_its_layout(one: Path, exports: Path) -> None:
    report = score([one], ScoreRequest(calibration=(exports / "opencv.yaml",)), Reading())
    (scored,) = report.sets
    assert (scored.name, scored.calibration, scored.format) == ("indoor", "opencv.yaml", "opencv")
    assert scored.distance_mm == 475.0
    assert scored.layout == device().truth.identity
    assert scored.figures["max_px"].value < 1e-6
    assert report.passed
    nearer = score([one], ScoreRequest(calibration=(exports / "opencv.yaml",), distance_mm=400.0), Reading())
    assert nearer.sets[0].distance_mm == 400.0


def test_a_folder_of_sets_takes_a_folder_of_calibrations_by_their_names(exports: Path, tmp_path: Path) -> None:
    for name in ("a", "b"):
        make_set(tmp_path / "suite" / name)
    (tmp_path / "found" / "b").mkdir(parents=True)
    shutil.copy(exports / "opencv.yaml", tmp_path / "found" / "a.yaml")
    shutil.copy(exports / "kalibr_camchain.yaml", tmp_path / "found" / "b" / "camchain.yaml")
    sets, request = [tmp_path / "suite"], ScoreRequest(calibration=(tmp_path / "found",))
    report = score(sets, request, Reading())
    assert [(scored.name, scored.format) for scored in report.sets] == [("a", "opencv"), ("b", "kalibr")]
    assert report.over_sets["rms_px"].sets == 2
    (tmp_path / "found" / "a.yaml").unlink()
    with pytest.raises(InputError, match="0 files or folders named a, expected one for the set"):
        score(sets, request, Reading())
    given = (exports / "opencv.yaml", exports / "colmap")
    sets = [tmp_path / "suite" / "a", tmp_path / "suite" / "b"]
    report = score(sets, ScoreRequest(calibration=given), Reading())
    assert [scored.alignment for scored in report.sets] == ["rigid", "similarity"]


def test_sets_of_one_name_are_told_apart(exports: Path, tmp_path: Path) -> None:
    sets = (make_set(tmp_path / "x" / "set"), make_set(tmp_path / "y" / "set"))
    report = score(sets, ScoreRequest(calibration=(exports / "opencv.yaml",) * 2), Reading())
    assert [scored.name for scored in report.sets] == ["x/set", "y/set"]


def test_a_covariance_beside_a_calibration_gives_nees(one: Path, exports: Path, tmp_path: Path) -> None:
    covariance = np.diag([0.01, 1e-6]).tolist()
    stated = {"schema": "mirrorcam.covariance/1", "parameters": ["all fx_px", "all k1"], "covariance": covariance}
    (tmp_path / "c.json").write_text(json.dumps(stated))
    request = ScoreRequest(calibration=(exports / "opencv.yaml",), covariance=(tmp_path / "c.json",))
    scored = score([one], request, Reading()).sets[0]
    assert scored.figures["nees"].value < 1e-6  # without an error
    assert scored.figures["nees_freedom"].value == 2.0


def test_pictures_flipped_otherwise_are_hinted_at(one: Path, exports: Path, tmp_path: Path) -> None:
    text = (exports / "opencv.yaml").read_text()
    assert "flip_code: 0\n" in text
    path = tmp_path / "a.yaml"
    path.write_text(text.replace("flip_code: 0\n", ""))
    request = ScoreRequest(calibration=(path,))
    assert score([one], request, Reading()).sets[0].notes == ()
    with pytest.raises(InputError) as caught:
        score([one], request, Reading(flip="left-right"))
    assert "camera 'view_0_0' shows 0% of what view_0_0 does" in str(caught.value)
    assert "; with --flip top-bottom it scores " in str(caught.value)
    scored = score([one], request, Reading(flip="as-is")).sets[0]
    assert scored.figures["rms_px"].value > 10.0
    assert len(scored.notes) == 1
    assert scored.notes[0].startswith("with --flip top-bottom it scores ")


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"sets": ("nowhere",)}, "nowhere: is not a folder, expected a set"),
        ({"sets": (".",)}, "no truth/layout.json in it or its subfolders"),
        ({"calibration": ("a.yaml", "b.yaml")}, "--calibration: 2 for 1 sets, expected one for each"),
        ({"calibration": ("nothing.yaml",)}, "nothing.yaml: no such file"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(
    changes: dict[str, tuple[str, ...]],
    complaint: str,
    one: Path,
    exports: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    given = {"sets": (one,), "calibration": (exports / "opencv.yaml",)} | changes
    with pytest.raises(InputError) as caught:
        score([Path(path) for path in given["sets"]], ScoreRequest(calibration=given["calibration"]), Reading())
    assert complaint in str(caught.value)
    assert "\n" not in str(caught.value)


def test_sets_are_found_in_their_order(tmp_path: Path) -> None:
    for name in ("b", "a"):
        make_set(tmp_path / name)
    (tmp_path / "c").mkdir()
    assert sets_in([tmp_path]) == (tmp_path / "a", tmp_path / "b")


def test_a_set_of_a_name_that_cannot_be_printed_is_refused(exports: Path, tmp_path: Path) -> None:
    named = make_set(tmp_path / "a\nb")
    with pytest.raises(InputError, match="expected 1 to 100 printable characters"):
        score([named], ScoreRequest(calibration=(exports / "opencv.yaml",)), Reading())


def test_a_report_is_three_files_of_the_same_bytes(one: Path, exports: Path, tmp_path: Path) -> None:
    report = score([one], ScoreRequest(calibration=(exports / "opencv.yaml",)), Reading())
    write_report(report, tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(FILES)
    first = [(tmp_path / name).read_bytes() for name in FILES]
    write_report(report, tmp_path)
    assert [(tmp_path / name).read_bytes() for name in FILES] == first
