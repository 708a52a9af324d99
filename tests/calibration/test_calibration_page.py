"""The report of a calibration: its verdict notices what is wrong, its figures are true, and it needs nothing else."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.calibration.calibration_page import report_html, write_report
from mirrorcam.core.figures.figure_texts import sigma_text
from mirrorcam.core.values import Metric
from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration
from mirrorcam.optics.calibration.diagnostics.left_out import LeftOut
from mirrorcam.optics.calibration.diagnostics.model_selection import OtherSurface
from mirrorcam.optics.calibration.diagnostics.score_test import Cause
from mirrorcam.optics.calibration.diagnostics.verdict import Verdict, check_solution
from mirrorcam.optics.calibration.diagnostics.view_statistics import frame_figures, view_figures
from mirrorcam.optics.calibration.diagnostics.worst_views import with_worst_views
from mirrorcam.optics.calibration.solver.observations import DIRECT
from tests.nightly import a_few
from tests.optics.calibration.sound_calibration import (
    NOISE_PX,
    rows_of,
    sound_calibration,
)
from tests.run.test_run_page import outline


@pytest.fixture
def calibration() -> Calibration:
    return sound_calibration()


def verdict_of(calibration: Calibration) -> Verdict:
    return check_solution(calibration, view_figures(calibration))


def test_a_sound_calibration_is_good_to_use(calibration: Calibration) -> None:
    verdict = verdict_of(calibration)
    assert verdict.state == "good", verdict.reasons
    assert verdict.reasons == verdict.advice == ()
    assert all(check.metric.limit is not None for check in verdict.checks)
    page = outline(report_html(calibration, command="mirrorcam calibrate"))
    assert "Good to use" in page.text
    assert "FAIL" not in page.text


def test_bending_of_the_mount_is_reported_with_the_common_motion(calibration: Calibration) -> None:
    page = outline(report_html(calibration, command="mirrorcam calibrate"))
    assert f"gravity rotate all mirrors together by {HARDWARE.mount.tilt_deg:g}° at most" in " ".join(page.text.split())


def many_outliers(calibration: Calibration) -> Calibration:
    inliers = calibration.inliers.copy()
    inliers[::20] = False
    return replace(calibration, inliers=inliers)


def outliers_in_a_picture(calibration: Calibration) -> Calibration:
    return replace(calibration, inliers=calibration.observations.frame != 2)


def outliers_in_a_view(calibration: Calibration) -> Calibration:
    return replace(
        calibration, inliers=(calibration.observations.view != 1) | (calibration.observations.corner % 2 > 0)
    )


def heavy_tails(calibration: Calibration) -> Calibration:
    residuals = calibration.residuals_px.copy()
    residuals[::25] *= 6.0
    return replace(calibration, residuals_px=residuals)


def a_shifted_view(calibration: Calibration) -> Calibration:
    residuals = calibration.residuals_px.copy()
    residuals[calibration.observations.view == 1] += [0.0, 3.0 * NOISE_PX]
    return replace(calibration, residuals_px=residuals)


def a_noisy_view(calibration: Calibration) -> Calibration:
    residuals = calibration.residuals_px.copy()
    residuals[calibration.observations.view == 1, 0] *= 1.8
    return replace(calibration, residuals_px=residuals)


def a_noisy_direct_view(calibration: Calibration) -> Calibration:
    residuals = calibration.residuals_px.copy()
    residuals[calibration.observations.view == DIRECT, 1] *= 1.8
    return replace(calibration, residuals_px=residuals)


def bad_on_others(calibration: Calibration) -> Calibration:
    return replace(calibration, metrics={**calibration.metrics, "held_out_scale": Metric(value=2.0, unit="1")})


def split_halves(calibration: Calibration) -> Calibration:
    assert calibration.diagnostics is not None
    splits = tuple(replace(split, overall_ratio=3.0) for split in calibration.diagnostics.splits)
    return replace(calibration, diagnostics=replace(calibration.diagnostics, splits=splits))


def vague_depth(calibration: Calibration) -> Calibration:
    assert calibration.diagnostics is not None
    depth = calibration.diagnostics.depth
    vague = replace(depth, calibration_mm=100.0 * depth.calibration_mm)
    return replace(calibration, diagnostics=replace(calibration.diagnostics, depth=vague))


def half_a_view(calibration: Calibration) -> Calibration:
    """Mirror 2 without the right part of its sub-image."""
    seen = calibration.observations
    left, right = np.sort(calibration.layout.outline_px(2)[:, 0])[[0, -1]]
    return rows_of(calibration, (seen.view != 2) | (seen.pixels[:, 0] < left + 0.4 * (right - left)))


def few_frames(calibration: Calibration) -> Calibration:
    seen = calibration.observations
    return rows_of(calibration, (seen.view != 3) | (seen.frame < 3))


def one_tilt(calibration: Calibration) -> Calibration:
    poses = calibration.rig_from_board.copy()
    poses[:, :3, :3] = poses[0, :3, :3]
    return replace(calibration, rig_from_board=poses)


def one_distance(calibration: Calibration) -> Calibration:
    return replace(
        calibration, rig_from_board=np.repeat(calibration.rig_from_board[:1], len(calibration.rig_from_board), 0)
    )


@pytest.mark.parametrize(
    ("spoil", "reason", "advice"),
    a_few(
        5,
        [
            (many_outliers, r"5\.\d% of the corners fit no model", "spread over pictures"),
            (outliers_in_a_picture, r"\d\.\d% of the corners fit no model", "look there for glare"),
            (
                outliers_in_a_view,
                r"\d+\.\d% of the corners fit no model",
                "corners are in mirror 0-1",
            ),
            (heavy_tails, r"\d\.\d% of the residuals are beyond 3", "spread over pictures"),
            (
                a_shifted_view,
                r"mean residuals are significant in \d+% of the cells",
                "red arrows of mirror 0-1",
            ),
            (
                a_noisy_view,
                r"the residuals of mirror 0-1 in x are \d\.\d times those of .* in [xy]",
                "arrows of mirror 0-1",
            ),
            (
                a_noisy_direct_view,
                r"the residuals of the bare camera in y are \d\.\d times",
                "arrows of the bare camera",
            ),
            (bad_on_others, r"residuals of held-out frames are \d\.\d+ times", "Take more pictures"),
            (split_halves, r"calibrations differ by 3\.0 times", "Do not rely on the stated uncertainty"),
            (vague_depth, "the depth uncertainty from calibration", "Take more pictures with tilted boards"),
            (half_a_view, r"corners fill \d+% of mirror 1-0", "Show the board at the .*right of mirror 1-0"),
            (few_frames, "mirror 1-1 shows the board in 3 frames", "Take 2 more pictures with the board in mirror 1-1"),
            (one_tilt, "no two boards differ by more than 0°", "Tilt the board more"),
            (
                one_distance,
                r"mirror \d-\d shows boards at nearly one distance",
                r"nearer to and farther from mirror \d-\d",
            ),
        ],
    ),
)
def test_every_check_fails_on_what_it_is_for(
    calibration: Calibration, spoil: Callable[[Calibration], Calibration], reason: str, advice: str
) -> None:
    spoiled = spoil(calibration)
    verdict = verdict_of(spoiled)
    assert verdict.state == "look"
    assert any(re.search(reason, words) for words in verdict.reasons), verdict.reasons
    assert any(re.search(advice, words) for words in verdict.advice), verdict.advice
    page = outline(report_html(spoiled, command="mirrorcam calibrate"))
    assert "Look at this before you use it" in page.text
    assert "FAIL" in page.text


def test_an_alarm_forbids_the_use(calibration: Calibration) -> None:
    assert calibration.diagnostics is not None
    alarmed = replace(calibration, diagnostics=replace(calibration.diagnostics, alarms=("the mirrors <bend>",)))
    verdict = verdict_of(alarmed)
    assert verdict.state == "stop"
    assert verdict.reasons[0] == "the mirrors <bend>"
    assert "what moved or bent" in verdict.advice[0]
    page = report_html(alarmed, command="mirrorcam calibrate")
    assert "Do not use it" in page
    assert "The mirrors &lt;bend&gt;." in page
    assert "<bend>" not in page


def test_an_alarm_names_the_model_that_the_pictures_ask_for(calibration: Calibration) -> None:
    diagnostics = calibration.diagnostics
    assert diagnostics is not None
    for name, other, advice in (
        ("joint+bend", None, "--model joint+bend"),
        ("joint+glass", OtherSurface(2.0, 0.01, is_second_surface=True), "--model second_surface+auto"),
        ("joint+glass", OtherSurface(0.0, 0.01, is_second_surface=False), "--model first_surface+auto"),
    ):
        comparison = replace(
            diagnostics.comparisons[-1], name=name, against="joint", supported=True, information_gain=50.0
        )
        alarmed = replace(
            diagnostics,
            model_name="joint",
            comparisons=(*diagnostics.comparisons, comparison),
            alarms=("something",),
            other_surface=other,
        )
        verdict = verdict_of(replace(calibration, diagnostics=alarmed))
        assert advice in verdict.advice[0]


def test_the_first_cause_leads_and_its_advice_replaces_that_on_symptoms(calibration: Calibration) -> None:
    assert calibration.diagnostics is not None
    causes = (Cause("mirror bent", 1, None, "bend", 0.61, 90.0, 3.0),)
    left_out = LeftOut((2,), (0.05, 0.04), 0.5)
    symptoms = many_outliers(replace(calibration, diagnostics=replace(calibration.diagnostics, causes=causes)))
    verdict = verdict_of(symptoms)
    assert verdict.state == "look"
    assert verdict.reasons[0] == "mirror 0-1 is not flat (61% of the misfit)"
    assert verdict.advice == ("Calibrate again with --model joint+bend, or mount mirror 0-1 without stress.",)
    picture = (Cause("picture", None, 2, "", 0.9, 90.0, 0.1),)
    harmless = replace(calibration, diagnostics=replace(calibration.diagnostics, causes=picture, left_out=left_out))
    assert verdict_of(harmless).state == "good"
    harmful = replace(calibration.diagnostics, causes=picture, left_out=left_out, alarms=("halves differ",))
    verdict = verdict_of(replace(calibration, diagnostics=harmful))
    assert verdict.state == "stop"
    assert verdict.reasons == ("picture frame 2 contradicts the other pictures (90% of the misfit)", "halves differ")
    assert verdict.advice == (
        "Calibrate again with --leave-out 'frame 2': residuals fall from 0.05 to 0.04 px, and the error bounds of the "
        "mirrors to 50%.",
    )
    page = outline(report_html(replace(calibration, diagnostics=harmful), command="mirrorcam calibrate"))
    assert page.text.index("Picture frame 2 contradicts") < page.text.index("What to do next")


def test_every_picture_is_listed_and_the_worst_views_are_shown(calibration: Calibration) -> None:
    residuals = calibration.residuals_px.copy()
    residuals[calibration.observations.frame == 3] *= 2.0
    grey = np.full((1080, 1920), 128, dtype=np.uint8)
    shown = with_worst_views(replace(calibration, residuals_px=residuals), lambda frame: grey)
    assert {view.frame for view in shown.worst_views} == {3}
    assert len(shown.worst_views) == 4
    frames = frame_figures(shown)
    assert frames[0].name == "frame 3"
    assert sorted(frame.frame for frame in frames) == list(range(len(calibration.pictures)))
    page = report_html(shown, command="mirrorcam calibrate")
    assert page.count("data:image/jpeg;base64,") == 4
    assert page.index('<th scope="row">frame 3<') < page.index('<th scope="row">frame 1<')


def test_without_evidence_it_says_so(calibration: Calibration) -> None:
    bare = replace(calibration, diagnostics=None)
    verdict = verdict_of(bare)
    assert verdict.state == "look"
    assert "the model was not checked" in verdict.reasons
    page = outline(report_html(bare, command="mirrorcam calibrate"))
    assert "How sure depth is" not in page.text
    assert "of direction" in page.text


def test_a_view_that_fits_nothing_and_depth_that_nobody_knows_are_said(calibration: Calibration) -> None:
    assert calibration.diagnostics is not None
    depth = calibration.diagnostics.depth
    unknown = np.full(len(depth.range_mm), np.nan)
    blind = replace(
        calibration,
        inliers=calibration.inliers & (calibration.observations.view != 2),
        diagnostics=replace(calibration.diagnostics, depth=replace(depth, matching_mm=unknown, calibration_mm=unknown)),
    )
    page = outline(report_html(blind, command=""))
    assert "Look at this before you use it" in page.text
    assert "mirror 1-0 shows the board in 0 frames".capitalize() in page.text
    assert "this layout gives no depth there" in page.text
    assert "nan" not in page.text


def test_one_file_holds_everything(calibration: Calibration, tmp_path: Path) -> None:
    write_report(calibration, tmp_path / "report.html", command="mirrorcam calibrate set/frames")
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    page = outline(text)
    assert page.targets == []
    assert "http" not in re.sub(r'xmlns="[^"]*"', "", text)
    assert "@import" not in text
    assert not re.search(r"url\((?!#)", text)
    assert "mirrorcam calibrate set/frames" in page.text
    names = re.findall(r' id="([^"]*)"', text)
    assert len(set(names)) == len(names)
    assert set(re.findall(r"url\(#([^)]*)\)", text)) <= set(names)
    assert not re.search(r"\bnan\b|\binf\b", text)
    assert text == report_html(calibration, command="mirrorcam calibrate set/frames")


def test_the_page_states_the_uncertainty_that_the_layout_carries(calibration: Calibration) -> None:
    known, diagnostics = calibration.layout.uncertainty, calibration.diagnostics
    assert known is not None
    assert diagnostics is not None
    assert diagnostics.mirrors is not None
    text = outline(report_html(calibration, command="")).text
    place = known.parameters.index("fx_px")
    assert f"{calibration.layout.camera.fx_px:.3f}{sigma_text(np.sqrt(known.covariance[place, place]))}" in text
    digits = max(len(sigma_text(sigma).partition(".")[2]) for sigma in diagnostics.mirrors.distance_mm)
    for number, mirror in enumerate(calibration.layout.mirrors):
        name = calibration.layout.mirror_names[number]
        assert (
            f"mirror {name}{mirror.distance_mm:.{digits}f}{sigma_text(diagnostics.mirrors.distance_mm[number])}" in text
        )


def test_notes_are_on_the_page_and_escaped(calibration: Calibration) -> None:
    page = report_html(replace(calibration, notes=("frame 3: no <board> & nothing",)), command="a <b>")
    assert "Frame 3: no &lt;board&gt; &amp; nothing." in page
    assert "a &lt;b&gt;" in page
    assert "photo_6.jpg: mirror" in report_html(replace(calibration, notes=("photo_6.jpg: mirror 0-1",)), command="")


def test_two_mirrors_without_a_device_omit_mount_and_drift(calibration: Calibration) -> None:
    """Nor are alarms said twice; what is least certain is no advice."""
    assert calibration.diagnostics is not None
    alarmed = replace(calibration.diagnostics, alarms=("halves differ",))
    foreign = calibration.layout.replaced(kind="nominal", spec=None)
    page = report_html(replace(calibration, layout=foreign, diagnostics=alarmed), command="")
    assert "printed mount" not in page
    assert "mirrorcam drift" not in page
    assert page.count("Halves differ") == 1
    advice, uncertainty = page.split("What to do next")[1].split("Largest uncertainty")
    assert calibration.diagnostics.weak[0].description not in advice.lower()
    assert calibration.diagnostics.weak[0].description[1:] in uncertainty
    assert "Notes: what was not found, not used, or not determined" in page
