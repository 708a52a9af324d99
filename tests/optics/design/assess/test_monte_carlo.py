"""The Monte Carlo study: zero tolerances, proportionality, the normal distribution, and shares of variance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.design.assess.as_built_views import built_views
from mirrorcam.optics.design.assess.layout_metrics import evaluate
from mirrorcam.optics.design.assess.monte_carlo import ACCURACIES, design_reference, study
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror, reflect
from mirrorcam.optics.geometry.perturbations import Perturbations, draw_as_built, draw_perturbations
from mirrorcam.optics.geometry.pupil import PINHOLE, Pupil
from mirrorcam.optics.geometry.tolerances import WORKMANSHIP, Tolerances
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.render_scenes.truth.light_rays import trace_via_mirror
from tests.nightly import a_few
from tests.optics.rim_rays import unvignetted

DEPTHS_MM = (300.0, 500.0)
# Quantiles of the standard normal distribution.
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
    assert found.cause_fractions == {}
    assert set(found.hidden.values()) == {0.0}


def test_small_faults_do_harm_in_proportion(default_layout: Layout) -> None:
    found = study(default_layout, Tolerances.hobby().times(0.05), DEPTHS_MM, devices=40)
    for name in ("uncalibrated_error_300mm", "misregistration_500mm"):
        reference = found.spreads[1.0][name]
        for accuracy in ACCURACIES:
            spread = found.spreads[accuracy][name]
            assert spread.median == pytest.approx(accuracy * reference.median, rel=0.01)
            assert spread.high == pytest.approx(accuracy * reference.high, rel=0.01)
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
    assert found.cause_fractions == {"mirror offset": dict.fromkeys(found.spreads[1.0], 1.0)}


@pytest.mark.slow
def test_shares_are_those_of_the_variance() -> None:
    """Shifted mirrors and a shifted camera each move the baseline in proportion, by known amounts."""
    layout = converging_pair()
    found = study(
        layout, Tolerances.none().replaced(offset_mm=0.6, camera_offset_mm=0.7), (300.0,), devices=1500
    ).cause_fractions
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
    assert list(found.cause_fractions) == ["camera itself"]


def test_a_hobby_printer_costs_efficiency_and_shares_name_the_cause(default_layout: Layout) -> None:
    found = study(default_layout, Tolerances.hobby(), DEPTHS_MM, devices=60)
    for name in (f"{kind}_efficiency_{depth_mm}mm" for kind in ("pixel", "usable") for depth_mm in (300, 500)):
        medians = [of[name].median for of in found.spreads.values()]
        assert medians == sorted(medians, reverse=True)
        assert medians[0] < found.spreads[1.0][name].nominal
    for of_cause in zip(*(shares.values() for shares in found.cause_fractions.values()), strict=True):
        assert sum(of_cause) == pytest.approx(1.0)
    tilt = found.cause_fractions["mirror tilt"]
    assert all(
        tilt["misregistration_300mm"] >= shares["misregistration_300mm"] for shares in found.cause_fractions.values()
    )
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
        (
            {"sheet_thickness_mm": 0.75},
            r"sheet_thickness_mm 0\.75.*, 2 times that: a sampled mirror is -\d\.\d mm thick",
        ),
        ({"tilt_deg": 45.0}, r"tolerances tilt_deg 45\.0, .*: a sampled mirror reaches"),
        ({"distortion_mean": (-0.6, 0.0, 0.0, 0.0, 0.0)}, "distortion .* is not monotonic on the sensor"),
    ],
)
def test_impossible_devices_are_refused_in_one_line(
    default_layout: Layout, changes: dict[str, object], complaint: str
) -> None:
    with pytest.raises(InputError, match=complaint) as error:
        study(default_layout, Tolerances.hobby().replaced(**changes), DEPTHS_MM)
    assert "\n" not in str(error.value)


def test_every_tolerance_is_a_cause_of_its_own(default_layout: Layout) -> None:
    everything = Tolerances.hobby().replaced(focal_percent=1.0)
    found = study(default_layout, everything, DEPTHS_MM, devices=3)
    assert len(found.cause_fractions) == len(WORKMANSHIP) + 1


def exact(layout: Layout) -> Perturbations:
    return draw_perturbations(Tolerances.none(), len(layout.mirrors), 1, np.random.default_rng(0))


def figures(
    layout: Layout, perturbations: Perturbations, depths_mm: tuple[float, ...] = DEPTHS_MM
) -> dict[str, FloatArray]:
    return design_reference(layout, depths_mm).figures(built_views(layout, perturbations))


def side_by_side() -> Layout:
    """Two mirrors at 45 degrees in one plane, 80 mm up, that show the scene to the left and the right."""
    middle, normal = np.array([0.0, 0.0, 80.0]), np.array([0.0, 1.0, -1.0])
    mirrors = []
    for left, right in ((-0.25, -0.01), (0.01, 0.25)):
        rays = np.array([[left, -0.15, 1], [right, -0.15, 1], [right, 0.15, 1], [left, 0.15, 1]])
        outline = rays * (middle @ normal / (rays @ normal))[:, None]
        mirrors.append(Mirror.from_plane(middle, normal, outline_in_rig_mm=outline))
    return Layout(rows=1, cols=2, camera=Camera.c920(), mirrors=tuple(mirrors))


def looking_at_one_point(half: float) -> Layout:
    """Three small mirrors in a row that show the point (0, 300, 80) mm in the centre of their sub-images."""
    target, mirrors = np.array([0.0, 300.0, 80.0]), []
    for u in (-0.3, 0.0, 0.3):
        ray = np.array([u, 0.0, 1.0])
        middle = 80.0 * ray
        normal = (target - middle) / np.linalg.norm(target - middle) - ray / np.linalg.norm(ray)
        rays = np.array([[u + x * half, y * half, 1.0] for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
        outline = rays * (middle @ normal / (rays @ normal))[:, None]
        mirrors.append(Mirror.from_plane(middle, normal, outline_in_rig_mm=outline))
    return Layout(rows=1, cols=3, camera=Camera.c920(), mirrors=tuple(mirrors))


@pytest.mark.parametrize("fixture", ["default_layout", "crooked_layout"])
def test_a_device_without_a_fault_has_the_figures_of_its_design(fixture: str, request: pytest.FixtureRequest) -> None:
    layout: Layout = request.getfixturevalue(fixture)
    depths_mm = (350.0, 600.0)
    found, designed = figures(layout, exact(layout), depths_mm), evaluate(layout, depths_mm)
    shared = [name for name in found if name in designed]
    assert len(shared) == (11 if layout.camera.aperture_mm else 9)
    for name in shared:
        assert found[name] == pytest.approx(designed[name].value, rel=1e-9), name
    for name in set(found) - set(shared) - {"usable_window", "off_sensor"}:
        assert found[name] == 0.0, name
    assert found["off_sensor"] == pytest.approx(0.0, abs=1e-6) or fixture == "crooked_layout"


@pytest.mark.parametrize("thickness_mm", a_few(1, [0.0, 1.5]))
def test_usable_efficiency_is_that_of_rays_from_the_rim(default_layout: Layout, thickness_mm: float) -> None:
    """Every 12th pixel of a device, horizontally and vertically, that shows the point unvignetted in each mirror.

    Through glass, views are those of apparent mirrors, which count a little less.
    """
    mirrors = default_layout.mirrors
    if thickness_mm:
        mirrors = tuple(mirror.replaced(surface="second", thickness_mm=thickness_mm) for mirror in mirrors)
    layout, tolerances = default_layout.replaced(mirrors=mirrors), Tolerances(tilt_deg=0.6, offset_mm=0.5)
    device = draw_as_built(layout, tolerances, np.random.default_rng(5))
    camera, pupil = device.camera, device.camera.pupil
    assert pupil.aperture_mm > 1.0
    across, upwards = (np.arange(5.5, size, 12.0) for size in (camera.width_px, camera.height_px))
    pixels = np.stack(np.meshgrid(across, upwards), axis=-1).reshape(-1, 2)
    shares = dict.fromkeys(DEPTHS_MM, 0.0)
    for mirror in device.mirrors:
        chief = camera.normalized_from_pixels(pixels)
        chief = chief[unvignetted(mirror, chief, pupil)]
        rays = np.column_stack([chief, np.ones(len(chief))])
        _, start, direction, _ = trace_via_mirror(mirror, rays / np.linalg.norm(rays, axis=1, keepdims=True))
        for depth_mm in DEPTHS_MM:
            forward = device.view_from_rig[2]
            steps = (depth_mm - start @ forward) / (direction @ forward)
            points = (start + steps[:, None] * direction)[steps > 0.0]
            for index, other in enumerate(device.mirrors):
                seen = device.project(points, index)
                on_sensor = ((seen > -0.5) & (seen < [camera.width_px - 0.5, camera.height_px - 0.5])).all(axis=1)
                points, seen = points[on_sensor], seen[on_sensor]
                points = points[unvignetted(other, camera.normalized_from_pixels(seen), pupil)]
            shares[depth_mm] += len(points) / len(pixels)
    found = figures(layout, draw_perturbations(tolerances, len(mirrors), 1, np.random.default_rng(5)))
    for depth_mm, share in shares.items():
        usable = found[f"usable_efficiency_{depth_mm:g}mm"]
        assert usable == pytest.approx(share, abs=0.01 if thickness_mm else 0.002)
        assert 0.03 < found[f"pixel_efficiency_{depth_mm:g}mm"] - usable < 0.1


def test_all_pixels_of_a_pinhole_are_usable(default_layout: Layout) -> None:
    pinhole = default_layout.replaced(camera=default_layout.camera.with_pupil(PINHOLE))
    assert not any(name.startswith("usable_efficiency") for name in figures(pinhole, exact(pinhole)))


def test_a_pupil_too_large_for_the_mirrors_leaves_nothing_in_common(default_layout: Layout) -> None:
    wide = default_layout.replaced(camera=default_layout.camera.with_pupil(Pupil(40.0, 500.0)))
    found = figures(wide, exact(wide))
    assert found["usable_efficiency_300mm"] == found["usable_efficiency_500mm"] == 0.0


def test_the_usable_window_is_what_the_decoder_finds_valid(default_layout: Layout) -> None:
    """The window is the bounding box of the region that all views share at the reference depth, for a pinhole."""
    pinhole = default_layout.replaced(camera=default_layout.camera.with_pupil(PINHOLE))
    decoder = Decoder(pinhole, margin_px=0.0)
    counted = (decoder.weights > 0).all(axis=(0, 1)).mean()
    assert figures(default_layout, exact(default_layout))["usable_window"] == pytest.approx(counted, abs=0.005)


def test_a_tilted_mirror_turns_its_view_by_twice_as_much() -> None:
    """A tilt by alpha rotates the image of a point D behind the centre M by 2 alpha about M, L + D from the pupil."""
    layout = looking_at_one_point(half=0.004)
    design = figures(layout, exact(layout), (300.0,))
    assert design["overlap_iou_300mm"] > 0.3
    for alpha in (1e-4, 0.01, 0.05):
        perturbations = exact(layout)
        perturbations.tilts_rad[0, 1, 0] = alpha
        found = figures(layout, perturbations, (300.0,))
        shift_px = 1360.38 * 300.0 * np.sin(2 * alpha) / (80.0 + 300.0 * np.cos(2 * alpha))
        # One of three views has an error; the region is small, not a point.
        assert found["uncalibrated_error_300mm"] == pytest.approx(shift_px / np.sqrt(3), rel=0.01)
        # One of three views has the error e, two have none: minus the mean, 2/3 e once and -1/3 e twice.
        assert found["misregistration_300mm"] == pytest.approx(shift_px * np.sqrt(2) / 3, rel=0.12)


def test_a_principal_point_elsewhere_is_an_error_of_as_many_pixels(default_layout: Layout) -> None:
    """All views move equally, except for the mirrors' different directions: little of it is misregistration."""
    found = figures(default_layout, replace(exact(default_layout), centre_px=np.array([[3.0, -4.0]])))
    for depth_mm in (300, 500):
        assert found[f"uncalibrated_error_{depth_mm}mm"] == pytest.approx(5.0)
        assert 0.1 < found[f"misregistration_{depth_mm}mm"] < 2.5


def test_a_thicker_mirror_moves_all_views_towards_the_pupil() -> None:
    layout = looking_at_one_point(half=0.001)
    found = figures(layout, replace(exact(layout), thickness_mm=np.array([0.2])), (300.0,))
    target = np.array([0.0, 300.0, 80.0])
    shifts = [
        layout.camera.project(reflect(target, (1.0 - 0.2 / m.distance_mm) * m.virtual_centre_in_rig_mm))
        - layout.camera.project(m.reflect(target))
        for m in layout.mirrors
    ]
    expected = np.sqrt(np.mean(np.sum(np.square(shifts), axis=1)))
    assert 0.5 < expected < 2.0
    assert found["uncalibrated_error_300mm"] == pytest.approx(expected, rel=0.01)


def test_what_leaves_the_sensor_is_counted() -> None:
    layout = looking_at_one_point(half=0.004)
    left_px = 959.5 - 0.3 * 1360.38
    found = figures(layout, replace(exact(layout), centre_px=np.array([[-left_px - 0.5, 0.0]])), (300.0,))
    assert found["off_sensor"] == pytest.approx(1.0 / 6.0)  # one half of one of three
    nothing = figures(layout, replace(exact(layout), centre_px=np.array([[-5000.0, 0.0]])), (300.0,))
    assert nothing["off_sensor"] == pytest.approx(1.0)
    for name in ("pixel_efficiency_300mm", "overlap_iou_300mm", "fov_x_deg", "fov_y_deg", "usable_window"):
        assert nothing[name] == 0.0, name


def test_baselines_are_those_of_the_mirrored_pupils() -> None:
    layout = looking_at_one_point(half=0.004)
    moved = np.array([0.8, -0.5, 0.3])
    found = figures(layout, replace(exact(layout), camera_shifts_mm=moved[None]), (300.0,))
    pupils = [mirror.reflect(moved)[0] for mirror in layout.mirrors]
    assert found["baseline_x_mm"] == pytest.approx(abs(pupils[2] - pupils[0]))
    assert "baseline_y_mm" not in found


def test_few_points_represent_the_region(default_layout: Layout) -> None:
    """The RMS error of a misaligned device, from a few points in the region and from ten thousand."""
    perturbations = draw_perturbations(Tolerances.hobby().times(0.2), 9, 1, np.random.default_rng(3))
    ideal, views = design_reference(default_layout, DEPTHS_MM), built_views(default_layout, perturbations)
    region = ideal.design.common_regions(300.0)[0][0]
    left, low, right, high = region.bounds
    grid = np.stack(np.meshgrid(np.linspace(left, right, 120), np.linspace(low, high, 120)), axis=-1).reshape(-1, 2)
    inside = grid[shapely.contains_xy(region, *grid.T)]
    points, mirrors = np.column_stack([inside, np.full(len(inside), 300.0)]), np.arange(9)[:, None]
    shifts = views.pixels(points, np.array(0), mirrors) - ideal.design.pixels(points, np.array(0), mirrors)
    rms = np.sqrt(np.mean(np.sum(shifts**2, axis=-1)))
    assert ideal.figures(views)["uncalibrated_error_300mm"] == pytest.approx(rms, rel=1e-3)
    assert len(ideal.probes[0].weights) < 40


def test_points_past_the_lens_model_do_not_count(free_layout: Layout) -> None:
    """The lens folds just beyond the sensor, where a turn of the camera moves points that the design sees."""
    perturbations = replace(
        exact(free_layout),
        lens=np.array([[0.0, 0.0, 0.0, 0.0, -0.19]]),
        camera_rotations_rad=np.array([[0.0, 0.25, 0.0]]),
    )
    ideal, views = design_reference(free_layout, DEPTHS_MM), built_views(free_layout, perturbations)
    known = np.isfinite(views.pixels(ideal.probes[0].points_mm, np.array(0), np.arange(9)[:, None]))
    assert 0.3 < known.mean() < 0.97
    for name, values in ideal.figures(views).items():
        assert np.isfinite(values).all(), name


def test_a_design_whose_views_share_nothing_is_refused() -> None:
    with pytest.raises(
        InputError, match="the views have no common region at 300 mm, expected a layout whose views overlap"
    ):
        design_reference(side_by_side(), DEPTHS_MM)
