"""NEES of calibrations that are drawn from their covariance is 1, and larger where the covariance is too small."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from mirrorcam.bench.scores.consistency import POSE_NAMES, Nees, pooled
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.camera_files.camera_rig import CameraRig
from mirrorcam.optics.camera_files.read.registry import rig_of
from mirrorcam.optics.geometry.layout import Uncertainty
from mirrorcam.optics.geometry.transforms import rigid
from tests.optics.calibration.sound_calibration import nominal_layout, sound_calibration, true_layout
from tests.optics.camera_files.rigs import Device, device, lens_of, moved, pose_of, true_rig

FOCAL = ("fx_px", "fy_px")
LENS = (*FOCAL, "cx_px", "cy_px", "k1")
SIGMAS = (0.2, 0.2, 0.3, 0.3, 1e-3)
DRAWS = 6


def covariance() -> tuple[tuple[str, ...], FloatArray]:
    """Parameters of a lens that all views share, and of the poses of all: some of it is the rig's own motion."""
    names = [f"all {name}" for name in LENS]
    sigmas = list(SIGMAS)
    for camera in true_rig(device().truth).cameras:
        names += [f"{camera.name} {name}" for name in POSE_NAMES]
        sigmas += [1e-4] * 3 + [0.03] * 3
    mixing = np.eye(len(names)) + 0.2 * np.random.default_rng(5).normal(size=(len(names),) * 2) / np.sqrt(len(names))
    root = np.array(sigmas)[:, None] * mixing
    return tuple(names), root @ root.T


def drawn(seed: int) -> CameraRig:
    """A calibration whose parameters are off by what the covariance says."""
    names, matrix = covariance()
    off = np.random.default_rng(seed).multivariate_normal(np.zeros(len(names)), matrix)
    rig, cameras = true_rig(device().truth), []
    for number, camera in enumerate(rig.cameras):
        lens = lens_of(camera)
        values = lens.intrinsics.copy()
        values[: len(LENS)] += off[: len(LENS)]
        turn, shift = np.split(off[len(LENS) + 6 * number :][:6], 2)
        pose = rigid(Rotation.from_rotvec(turn).as_matrix(), shift) @ pose_of(camera)
        cameras.append(replace(camera, lens=lens.with_intrinsics(values), camera_from_rig=pose))
    return replace(rig, cameras=tuple(cameras))


def found_in(rigs: list[CameraRig], factor: float) -> Nees:
    names, matrix = covariance()
    stated = Uncertainty(parameters=names, covariance=factor * matrix)
    each = [device().score(replace(rig, uncertainty=stated)).nees for rig in rigs]
    together = pooled([one for one in each if one is not None])
    assert together is not None
    return together


@pytest.fixture(scope="module")
def draws() -> list[CameraRig]:
    return [drawn(seed) for seed in range(DRAWS)]


def test_nees_of_drawn_calibrations_is_one(draws: list[CameraRig]) -> None:
    found = found_in(draws, 1.0)
    # Five of the lens and six of each of six poses, less the motion of the rig.
    assert found.freedom == DRAWS * (len(LENS) + 6 * 6 - 6)
    low, high = chi2.ppf([1e-4, 1.0 - 1e-4], found.freedom) / found.freedom
    assert low < found.mean < high
    assert found.mean == pytest.approx(1.0, abs=0.25)


@pytest.mark.slow
def test_nees_is_in_proportion_to_how_small_the_covariance_is(draws: list[CameraRig]) -> None:
    once, quarter = found_in(draws[:2], 1.0), found_in(draws[:2], 0.25)
    assert quarter.mean == pytest.approx(4.0 * once.mean, rel=1e-6)


def test_nees_does_not_depend_on_where_the_rig_stands() -> None:
    names, matrix = covariance()
    rig = replace(drawn(1), uncertainty=Uncertainty(parameters=names, covariance=matrix))
    motion = rigid(Rotation.from_rotvec([0.4, -0.2, 0.9]).as_matrix(), [100.0, -50.0, 30.0])
    first, second = (device().score(each).nees for each in (rig, moved(rig, motion)))
    assert first is not None
    assert second is not None
    assert second.mean == pytest.approx(first.mean, rel=1e-5)
    assert second.freedom == first.freedom


def test_a_sound_calibration_of_our_own_is_as_wrong_as_it_says() -> None:
    own = Device(true_layout(), nominal_layout())
    found = own.score(rig_of(sound_calibration().layout)).nees
    assert found is not None
    low, high = chi2.ppf([1e-4, 1.0 - 1e-4], found.freedom) / found.freedom
    assert low < found.mean < high


def test_intervals_hold_95_of_100() -> None:
    low, high = Nees(10.0, 20).interval
    assert chi2.cdf(high * 20, 20) - chi2.cdf(low * 20, 20) == pytest.approx(0.95)
    assert Nees(10.0, 20).mean == 0.5
    assert pooled([Nees(10.0, 20), Nees(50.0, 30)]) == Nees(60.0, 50)
    assert pooled([]) is None


def test_without_a_covariance_or_with_none_to_predict_it_is_not_given() -> None:
    rig = true_rig(device().truth)
    assert device().score(rig).not_given["nees"] == "the calibration has no covariance"
    nothing = Uncertainty(parameters=("all fx_px",), covariance=np.zeros((1, 1)))
    assert device().score(replace(rig, uncertainty=nothing)).not_given["nees"] == "its covariance predicts no error"


def test_lateral_colour_leaves_the_magnification_of_grey_pictures_open() -> None:
    names, matrix = covariance()
    rig = replace(drawn(1), uncertainty=Uncertainty(parameters=names, covariance=matrix))

    def magnified(factor: float) -> CameraRig:
        cameras = []
        for camera in rig.cameras:
            lens = lens_of(camera)
            scale = np.ones(len(lens.intrinsics))
            scale[: len(FOCAL)] = factor
            cameras.append(replace(camera, lens=lens.with_intrinsics(lens.intrinsics * scale)))
        return replace(rig, cameras=tuple(cameras))

    once, more = (device().score(magnified(factor), lateral_colour=True).nees for factor in (1.0, 1.002))
    fixed, fixed_more = (device().score(magnified(factor)).nees for factor in (1.0, 1.002))
    assert once is not None
    assert more is not None
    assert fixed is not None
    assert fixed_more is not None
    assert once.freedom == fixed.freedom - 1
    assert more.mean == pytest.approx(once.mean, rel=0.05), "the centre of the lens is off by 0.3 px"
    assert fixed_more.mean > 2.0 * fixed.mean
