"""The Monte Carlo study: nothing in, nothing out; proportion; the normal distribution; shares of variance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirrorcam.core.values import InputError
from mirrorcam.optics.design.assess.monte_carlo import ACCURACIES, study
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.tolerances import WORKMANSHIP, Tolerances

DEPTHS_MM = (300.0, 500.0)
# Of the standard normal distribution.
P95 = 1.6449


def converging_pair() -> Layout:
    """Two mirrors, 80 mm up, whose views cross 300 mm ahead."""
    target, mirrors = np.array([0.0, 300.0, 80.0]), []
    for left, right in ((-0.35, -0.02), (0.02, 0.35)):
        ray = np.array([(left + right) / 2.0, 0.0, 1.0])
        middle = 80.0 * ray
        normal = (target - middle) / np.linalg.norm(target - middle) - ray / np.linalg.norm(ray)
        rays = np.array([[left, -0.15, 1], [right, -0.15, 1], [right, 0.15, 1], [left, 0.15, 1]])
        outline = rays * (middle @ normal / (rays @ normal))[:, None]
        mirrors.append(Mirror.from_plane(middle, normal, outline_in_rig_mm=outline))
    return Layout(rows=1, cols=2, camera=Camera.c920(), mirrors=tuple(mirrors))


def test_without_tolerances_every_device_is_the_design(default_layout: Layout) -> None:
    found = study(default_layout, Tolerances.none(), DEPTHS_MM, devices=4)
    assert tuple(found.spreads) == ACCURACIES
    for spreads in found.spreads.values():
        for spread in spreads.values():
            assert spread.low == spread.median == spread.high
            assert spread.median == pytest.approx(spread.nominal, rel=1e-12)
    assert found.shares == {}
    assert set(found.hidden.values()) == {0.0}


def test_small_faults_do_harm_in_proportion(default_layout: Layout) -> None:
    found = study(default_layout, Tolerances.hobby().times(0.05), DEPTHS_MM, devices=40)
    for name in ("uncalibrated_error_300mm", "misregistration_500mm"):
        whole = found.spreads[1.0][name]
        for accuracy in ACCURACIES:
            spread = found.spreads[accuracy][name]
            assert spread.median == pytest.approx(accuracy * whole.median, rel=0.01)
            assert spread.high == pytest.approx(accuracy * whole.high, rel=0.01)
    baselines = [spreads["baseline_x_mm"] for spreads in found.spreads.values()]
    widths = np.array([spread.high - spread.low for spread in baselines])
    np.testing.assert_allclose(widths / widths[2], ACCURACIES, rtol=0.01)


def test_percentiles_are_those_of_the_normal_distribution() -> None:
    """A shift s along its normal moves a virtual centre by 2 s n: the baseline is normally distributed."""
    layout = converging_pair()
    found = study(layout, Tolerances.none().replaced(offset_mm=0.4), (300.0,), devices=2000)
    sigma = 2.0 * 0.4 * np.hypot(*(mirror.normal_in_rig[0] for mirror in layout.mirrors))
    for accuracy, spreads in found.spreads.items():
        spread = spreads["baseline_x_mm"]
        assert spread.nominal == pytest.approx(np.diff(layout.virtual_centres_in_rig_mm[:, 0])[0], rel=1e-9)
        assert (spread.median - spread.nominal) / (accuracy * sigma) == pytest.approx(0.0, abs=0.08)
        assert (spread.high - spread.nominal) / (accuracy * sigma) == pytest.approx(P95, abs=0.12)
        assert (spread.low - spread.nominal) / (accuracy * sigma) == pytest.approx(-P95, abs=0.12)
    assert found.shares == {"mirror offset": dict.fromkeys(found.spreads[1.0], 1.0)}


def test_shares_are_those_of_the_variance() -> None:
    """Shifted mirrors and a shifted camera each move the baseline in proportion, by known amounts."""
    layout = converging_pair()
    found = study(
        layout, Tolerances.none().replaced(offset_mm=0.6, camera_offset_mm=0.7), (300.0,), devices=1500
    ).shares
    first, second = (mirror.normal_in_rig for mirror in layout.mirrors)
    by_mirrors = (2.0 * 0.6) ** 2 * (first[0] ** 2 + second[0] ** 2)
    by_camera = (2.0 * 0.7) ** 2 * np.sum((first[0] * first - second[0] * second) ** 2)
    assert 0.2 < by_mirrors / (by_mirrors + by_camera) < 0.35
    assert found["mirror offset"]["baseline_x_mm"] == pytest.approx(by_mirrors / (by_mirrors + by_camera), abs=0.04)
    for name, share in found["camera offset"].items():
        assert share + found["mirror offset"][name] == pytest.approx(1.0)


def test_the_camera_itself_is_no_better_in_a_better_holder(default_layout: Layout) -> None:
    tolerances = Tolerances.none().replaced(centre_px=6.0)
    found = study(default_layout, tolerances, DEPTHS_MM, devices=20)
    for name, spread in found.spreads[1.0].items():
        for accuracy in ACCURACIES:
            assert found.spreads[accuracy][name] == spread
    assert found.spreads[1.0]["uncalibrated_error_300mm"].median > 3.0
    assert list(found.shares) == ["camera itself"]


def test_a_hobby_printer_costs_efficiency_and_tells_which_tolerance_matters(default_layout: Layout) -> None:
    found = study(default_layout, Tolerances.hobby(), DEPTHS_MM, devices=60)
    for name in (f"{kind}_efficiency_{depth_mm}mm" for kind in ("pixel", "usable") for depth_mm in (300, 500)):
        medians = [of[name].median for of in found.spreads.values()]
        assert medians == sorted(medians, reverse=True)
        assert medians[0] < found.spreads[1.0][name].nominal
    for of_cause in zip(*(shares.values() for shares in found.shares.values()), strict=True):
        assert sum(of_cause) == pytest.approx(1.0)
    tilt = found.shares["mirror tilt"]
    assert all(tilt["misregistration_300mm"] >= shares["misregistration_300mm"] for shares in found.shares.values())
    assert found.hidden[0.25] == 0.0 < found.hidden[2.0] < 1.0


def test_the_same_seed_gives_the_same_study(default_layout: Layout) -> None:
    first, again, other = (
        study(default_layout, Tolerances.hobby(), DEPTHS_MM, devices=5, seed=seed) for seed in (1, 1, 2)
    )
    assert first == again
    assert first != replace(other, spreads=first.spreads)
    assert first.spreads != other.spreads


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"sheet_thickness_mm": 0.25}, r"sheet_thickness_mm 0\.25.*, 2 times that: a drawn mirror is -0\.\d+ mm thick"),
        ({"tilt_deg": 45.0}, r"tolerances tilt_deg 45\.0, .*: a drawn mirror reaches"),
        ({"distortion_mean": (-0.6, 0.0, 0.0, 0.0, 0.0)}, "distortion .* folds inside the sensor"),
    ],
)
def test_what_cannot_be_built_is_refused_in_one_line(
    default_layout: Layout, changes: dict[str, object], complaint: str
) -> None:
    with pytest.raises(InputError, match=complaint) as error:
        study(default_layout, Tolerances.hobby().replaced(**changes), DEPTHS_MM)
    assert "\n" not in str(error.value)


def test_every_tolerance_is_a_cause_of_its_own(default_layout: Layout) -> None:
    everything = Tolerances.hobby().replaced(focal_percent=1.0)
    found = study(default_layout, everything, DEPTHS_MM, devices=3)
    assert len(found.shares) == len(WORKMANSHIP) + 1
