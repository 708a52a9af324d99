"""Decoding against analytic scenes, whose frames are traced pixel by pixel."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray, Metric
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.lateral_colour import LateralColour
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.pupil import PINHOLE
from mirrorcam.optics.light_field.decoder import (
    OUTLINE_MARGIN_PX,
    Decoder,
    Field,
    check_belongs,
    default_reference_depth_mm,
)
from mirrorcam.optics.light_field.equalisation import Equalisation
from mirrorcam.optics.light_field.light_field import LightField
from mirrorcam.optics.light_field.render.refocusing import FocalPlane, refocus
from mirrorcam.render_scenes.sets.sensor_model import magnify
from mirrorcam.render_scenes.truth.light_rays import trace_via_mirror
from mirrorcam.render_scenes.truth.pupil_maps import PupilTracer, pupil_maps
from tests.nightly import a_few
from tests.optics.light_field.photographs import letter, photographed, seen_by_pinholes, waves


def shift_px(found: FloatArray, expected: FloatArray, valid: NDArray[np.bool_]) -> FloatArray:
    """Return the mean shift (u, v) in px between two pictures (v, u), by least squares on gradients."""
    inner = valid.copy()
    inner[[0, -1]] = inner[:, [0, -1]] = False
    slopes: FloatArray = np.stack([np.asarray(np.gradient(expected, axis=axis))[inner] for axis in (1, 0)], axis=1)
    found_less_expected: FloatArray = found[inner] - expected[inner]
    return np.asarray(-np.linalg.solve(slopes.T @ slopes, slopes.T @ found_less_expected), dtype=np.float64)


@pytest.fixture(scope="module")
def crooked(crooked_layout: Layout) -> Decoder:
    return Decoder(crooked_layout)


@pytest.mark.parametrize("depth_mm", [380.0, 442.1, 650.0])
def test_a_view_matches_a_pinhole_at_its_true_position(
    crooked: Decoder, crooked_layout: Layout, depth_mm: float
) -> None:
    light_field = crooked.decode(photographed(crooked_layout, depth_mm, waves))
    expected = seen_by_pinholes(crooked.views, depth_mm, waves)
    for t, s in np.ndindex(2, 3):
        valid = light_field.valid[t, s]
        found = light_field.samples[t, s, :, :, 0].astype(np.float64)
        assert np.abs(shift_px(found, expected[t, s], valid)).max() < 0.003
        error = np.abs(found - expected[t, s])[valid]
        slope_v, slope_u = np.gradient(expected[t, s])
        steepest = float(np.hypot(slope_v, slope_u).max())
        assert error.max() < 0.1 * steepest  # 0.1 px where the texture is steepest


@pytest.mark.parametrize("depth_mm", a_few(1, [500.0, 380.0]))
def test_sheets_decode_exactly_at_the_reference_plane_and_approximately_elsewhere(
    crooked_layout: Layout, depth_mm: float
) -> None:
    slabs = tuple(
        Mirror.second_surface(m.virtual_centre_in_rig_mm, m.outline_in_rig_mm, thickness_mm=3.0, refractive_index=1.49)
        for m in crooked_layout.mirrors
    )
    layout = crooked_layout.replaced(mirrors=slabs)
    decoder = Decoder(layout, reference_depth_mm=500.0)
    camera = layout.camera
    u, v = np.meshgrid(np.arange(camera.width_px, dtype=float), np.arange(camera.height_px, dtype=float))
    rays = camera.unproject(np.stack([u, v], axis=-1))
    frame = np.zeros((camera.height_px, camera.width_px), dtype=np.float32)
    for mirror in slabs:
        # Traced from face to face, by code that decoding does not use.
        _, leaves, along, _ = trace_via_mirror(mirror, rays / np.linalg.norm(rays, axis=-1, keepdims=True))
        hit = np.isfinite(leaves[..., 0])
        start, turned = leaves[hit] @ layout.view_from_rig.T, along[hit] @ layout.view_from_rig.T
        points = start + turned * ((depth_mm - start[:, 2]) / turned[:, 2])[:, None]
        frame[hit] = waves(points[:, 0], points[:, 1])
    light_field = decoder.decode(frame)
    expected = seen_by_pinholes(decoder.views, depth_mm, waves)
    exact = depth_mm == decoder.views.reference_depth_mm
    for t, s in np.ndindex(2, 3):
        found, valid = light_field.samples[t, s, :, :, 0].astype(np.float64), light_field.valid[t, s]
        assert valid.mean() > 0.5
        assert np.abs(shift_px(found, expected[t, s], valid)).max() < (0.003 if exact else 0.1)
        slope_v, slope_u = np.gradient(expected[t, s])
        worst = float(np.abs(found - expected[t, s])[valid].max() / np.hypot(slope_v, slope_u).max())
        assert worst < (0.1 if exact else 0.5)  # px, where the texture is steepest
    plain = Decoder(crooked_layout, reference_depth_mm=500.0)
    off = plain.decode(frame).samples[0, 0, :, :, 0].astype(np.float64)
    shown = plain.decode(frame).valid[0, 0]
    assert np.abs(shift_px(off, seen_by_pinholes(plain.views, depth_mm, waves)[0, 0], shown)).max() > 0.01


def test_a_moved_mirror_is_detected(crooked: Decoder, crooked_layout: Layout) -> None:
    mirrors = list(crooked_layout.mirrors)
    mirrors[1] = mirrors[1].moved(np.eye(3), np.array([0.0, 0.0, 0.5]))
    moved = crooked_layout.replaced(mirrors=tuple(mirrors))
    light_field = crooked.decode(photographed(moved, 442.1, waves))
    expected = seen_by_pinholes(crooked.views, 442.1, waves)
    found = light_field.samples[0, 1, :, :, 0].astype(np.float64)
    assert np.abs(shift_px(found, expected[0, 1], light_field.valid[0, 1])).max() > 0.2


def second_surface(layout: Layout) -> Layout:
    """Return second-surface mirrors of 3 mm that match the mirrors of a layout along their chief rays."""
    mirrors = [
        Mirror.second_surface(
            mirror.virtual_centre_in_rig_mm, mirror.outline_in_rig_mm, thickness_mm=3.0, refractive_index=1.49
        )
        for mirror in layout.mirrors
    ]
    return layout.replaced(mirrors=tuple(mirrors))


def test_second_surface_mirrors_are_traced_ray_by_ray(crooked_layout: Layout) -> None:
    layout = second_surface(crooked_layout)
    decoder = Decoder(layout)
    depth_mm = decoder.views.reference_depth_mm
    light_field = decoder.decode(photographed(layout, depth_mm, waves))
    plain = Decoder(layout.replaced(mirrors=tuple(mirror.apparent for mirror in layout.mirrors)))
    as_if_plain = plain.decode(photographed(layout, depth_mm, waves))
    expected = seen_by_pinholes(decoder.views, depth_mm, waves)
    for t, s in np.ndindex(2, 3):
        assert light_field.valid[t, s].mean() > 0.4
        found = light_field.samples[t, s, :, :, 0].astype(np.float64)
        steepest = float(np.hypot(*np.gradient(expected[t, s])).max())
        assert np.abs(found - expected[t, s])[light_field.valid[t, s]].max() < 0.1 * steepest
        assert np.abs(shift_px(found, expected[t, s], light_field.valid[t, s])).max() < 0.003
    # The equivalent first-surface mirrors are another model, whose errors grow with the angle to the chief ray.
    far_off = np.abs(as_if_plain.samples[..., 0] - seen_by_pinholes(plain.views, depth_mm, waves))[as_if_plain.valid]
    close = np.abs(light_field.samples[..., 0] - expected)[light_field.valid]
    assert np.percentile(far_off, 99) > 2 * np.percentile(close, 99)


@pytest.mark.parametrize("depth_mm", [350.0, 600.0])
def test_away_from_the_reference_plane_sheets_stay_within_a_tenth_of_a_pixel(
    crooked_layout: Layout, depth_mm: float
) -> None:
    layout = second_surface(crooked_layout)
    decoder = Decoder(layout)
    light_field = decoder.decode(photographed(layout, depth_mm, waves))
    expected = seen_by_pinholes(decoder.views, depth_mm, waves)
    for t, s in np.ndindex(2, 3):
        found = light_field.samples[t, s, :, :, 0].astype(np.float64)
        assert np.abs(shift_px(found, expected[t, s], light_field.valid[t, s])).max() < 0.1


@pytest.mark.parametrize("depth_mm", [380.0, 650.0])
def test_views_moved_to_a_regular_grid_are_exact_at_the_depth_named(crooked_layout: Layout, depth_mm: float) -> None:
    decoder = Decoder(crooked_layout, regular_grid_at_mm=depth_mm)
    true = Decoder(crooked_layout)
    moved_mm = np.linalg.norm(decoder.views.positions_mm - true.views.positions_mm, axis=-1)
    assert moved_mm.max() > 0.5
    assert np.allclose(np.diff(decoder.views.positions_mm, axis=1), decoder.views.step_mm("s") * np.eye(3)[0])
    light_field = decoder.decode(photographed(crooked_layout, depth_mm, waves))
    expected = seen_by_pinholes(decoder.views, depth_mm, waves)
    unmoved = true.decode(photographed(crooked_layout, depth_mm, waves))
    shifts = np.zeros((2, 3, 2))
    for t, s in np.ndindex(2, 3):
        valid = light_field.valid[t, s]
        assert valid.mean() > 0.4
        found = light_field.samples[t, s, :, :, 0].astype(np.float64)
        assert np.abs(shift_px(found, expected[t, s], valid)).max() < 0.003
        both = unmoved.samples[t, s, :, :, 0].astype(np.float64)
        shifts[t, s] = shift_px(both, expected[t, s], unmoved.valid[t, s])
    assert np.abs(shifts).max() > 0.1  # removed by the correction


@pytest.fixture(scope="module")
def lit_evenly(parabola_layout: Layout) -> tuple[Layout, NDArray[np.uint8]]:
    """Return mirrors before a lens, and a frame of a scene of uniform grey level 200, traced by rays of the pupil."""
    camera = Camera(
        width_px=480, height_px=270, fx_px=340.0, fy_px=340.0, cx_px=239.5, cy_px=134.5, aperture_mm=2.4, focus_mm=500.0
    )
    layout = parabola_layout.replaced(camera=camera)
    maps = pupil_maps(PupilTracer(layout, camera.pupil))
    return layout, np.rint(200.0 * (maps["first.share"] + maps["second.share"])).astype(np.uint8)


def test_a_uniform_scene_is_uniform_up_to_the_borders_of_views(lit_evenly: tuple[Layout, NDArray[np.uint8]]) -> None:
    layout, frame = lit_evenly
    decoder = Decoder(layout, field="union")
    as_pinhole = Decoder(layout.replaced(camera=layout.camera.with_pupil(PINHOLE)), field="union")
    light_field = decoder.decode(frame)
    partial = light_field.valid & (light_field.weights < 0.9)
    assert partial.mean() > 0.02
    assert light_field.weights[partial].min() < 0.65
    # The frame itself is accurate to 2 % where the pupil is partly vignetted.
    error = light_field.samples[..., 0] - 200.0
    assert np.abs(error[light_field.valid]).max() <= 10.0
    assert np.abs(error[partial].mean()) < 0.5
    dark = as_pinhole.decode(frame)
    assert dark.samples[dark.valid].min() < 160
    # The mean of several views is uniform, too, where one of them ends.
    for each, most in ((light_field, 8.0), (dark, np.inf)):
        picture = refocus(each, FocalPlane.at_depth(each, 420.0))
        shown = 255.0 * picture.image[picture.valid]
        assert np.abs(shown - 200.0).max() <= most
    assert shown.min() < 170.0


def test_frames_with_a_gamma_curve_are_brightened_by_its_exponent(lit_evenly: tuple[Layout, NDArray[np.uint8]]) -> None:
    layout, frame = lit_evenly
    decoder, exponent = Decoder(layout), 1.0 / 2.2
    curved = np.rint(255.0 * (frame / 255.0) ** exponent).astype(np.uint8)
    shape = decoder.views.rows, decoder.views.cols, 1
    known = Equalisation(layout_identity=layout.identity, gain=np.ones(shape), exponent=exponent)
    light_field = decoder.equalised(known).decode(curved)
    valid = light_field.valid
    assert np.abs(light_field.samples[valid] - 255.0 * (200.0 / 255.0) ** exponent).max() <= 6.0
    # Decoded as from a linear camera, they are far too bright there.
    assert decoder.decode(curved).samples[valid].max() > 250


def test_frames_of_all_types_are_brightened_equally(lit_evenly: tuple[Layout, NDArray[np.uint8]]) -> None:
    layout, frame = lit_evenly
    decoder = Decoder(layout)
    colours = np.stack([frame, frame // 2, frame // 3], axis=-1)
    of_bytes = decoder.decode(colours).samples
    of_floats = decoder.decode(np.float32(1.0 / 255.0) * colours.astype(np.float32)).samples
    assert np.abs(of_bytes - 255.0 * of_floats).max() < 2.0
    assert np.array_equal(decoder.decode(frame).samples[..., 0], of_bytes[..., 0])
    assert not of_bytes[~decoder.decode(colours).valid].any()


def test_frames_of_another_layout_are_refused(crooked_layout: Layout) -> None:
    check_belongs(crooked_layout, crooked_layout.identity, "video.mp4")
    calibrated = crooked_layout.replaced(kind="calibrated", provenance={"nominal": "feedfeedfeedfeed"})
    check_belongs(calibrated, "feedfeedfeedfeed", "video.mp4")
    with pytest.raises(
        InputError, match=r"^video.mp4 was taken with layout 0123, expected [0-9a-f]{16} of the given layout"
    ):
        check_belongs(crooked_layout, "0123", "video.mp4")


def test_eight_bit_frames_decode_to_the_same_values(crooked: Decoder, crooked_layout: Layout) -> None:
    frame = photographed(crooked_layout, 500.0, waves)
    fine = crooked.decode(frame).samples
    coarse = crooked.decode(np.rint(frame * 255).astype(np.uint8)).samples
    assert coarse.dtype == np.uint8
    assert np.abs(coarse / 255.0 - fine).max() < 2.0 / 255


@pytest.mark.parametrize("which", ["parabola_layout", "crooked_layout"])
def test_views_are_upright_and_not_mirrored(which: str, request: pytest.FixtureRequest) -> None:
    layout: Layout = request.getfixturevalue(which)
    decoder = Decoder(layout)
    reference = decoder.views.reference_view_in_rig_mm @ layout.view_from_rig.T

    def hung(x: FloatArray, y: FloatArray) -> FloatArray:
        return letter(x - reference[0], y - reference[1] - 4.0)

    views = decoder.decode(photographed(layout, decoder.views.reference_depth_mm, hung)).samples[..., 0]
    upright = seen_by_pinholes(decoder.views, decoder.views.reference_depth_mm, hung)[0, 0]
    assert upright.sum() > 500
    for view in views.reshape(-1, *views.shape[2:]):
        # Compared about the letter's centre, so that rotating or mirroring does not shift it.
        rows, cols = (np.flatnonzero(upright.any(axis=axis)) for axis in (1, 0))
        box = (slice(rows[0], rows[-1] + 1), slice(cols[0], cols[-1] + 1))
        wanted, found = upright[box], view[box]
        agreement = {
            "upright": np.mean(np.abs(found - wanted)),
            "mirrored": np.mean(np.abs(found - wanted[:, ::-1])),
            "upside down": np.mean(np.abs(found - wanted[::-1])),
            "turned by 180 degrees": np.mean(np.abs(found - wanted[::-1, ::-1])),
        }
        assert min(agreement, key=lambda name: agreement[name]) == "upright"
        assert agreement["upright"] < 0.1
        # Without the pinhole model: the stem is on the left, the long bar on top.
        assert found[:, : found.shape[1] // 3].sum() > 2 * found[:, -found.shape[1] // 3 :].sum()
        assert found[: found.shape[0] // 3].sum() > 1.5 * found[-found.shape[0] // 3 :].sum()


@pytest.mark.parametrize(("farther_mm", "sign"), [(0.0, 0), (-60.0, 1), (90.0, -1)])
def test_disparity_is_zero_at_the_reference_depth_and_positive_nearer(
    crooked: Decoder, crooked_layout: Layout, farther_mm: float, sign: int
) -> None:
    views = crooked.views
    depth = views.reference_depth_mm + farther_mm
    for pixel in ([115.0, 111.0], [80.0, 130.0], [160.0, 90.0]):
        x, y, _ = crooked_layout.view_from_rig @ views.plane_points_in_rig(depth, np.array(pixel))

        def spot(px: FloatArray, py: FloatArray, x: float = x, y: float = y) -> FloatArray:
            return np.exp(-0.5 * ((px - x) ** 2 + (py - y) ** 2) / 1.5**2)

        samples = crooked.decode(photographed(crooked_layout, depth, spot)).samples[..., 0].astype(np.float64)
        total = samples.sum(axis=(2, 3))[..., None]
        found = np.einsum("tsvu,vuk->tsk", samples, views.pixel_grid()) / total
        assert np.abs(found - views.project(crooked_layout.view_from_rig.T @ [x, y, depth])).max() < 0.05
        along_s, along_t = np.diff(found[..., 0], axis=1), np.diff(found[..., 1], axis=0)
        if sign:
            assert (np.sign(along_s) == -sign).all()
            assert (np.sign(along_t) == -sign).all()
        else:
            assert max(np.abs(along_s).max(), np.abs(along_t).max()) < 0.05


@pytest.mark.parametrize("field", ["common", "union"])
@pytest.mark.parametrize("which", a_few(1, ["parabola_layout", "crooked_layout"]))
def test_a_valid_pixel_comes_from_inside_its_mirror(which: str, field: Field, request: pytest.FixtureRequest) -> None:
    layout: Layout = request.getfixturevalue(which)
    decoder = Decoder(layout, field=field)
    camera = layout.camera
    views = decoder.views
    plane = views.plane_points_in_rig(views.reference_depth_mm, views.pixel_grid())
    inner = np.array([camera.width_px - 1.0, camera.height_px - 1.0])
    for index, weights in enumerate(decoder.weights.reshape(-1, *decoder.weights.shape[2:])):
        sources = layout.project(plane[weights > 0], index)
        assert len(sources) > 1000
        assert ((sources >= 0) & (sources <= inner)).all()
        seen = camera.normalized_from_pixels(sources)
        outline = shapely.Polygon(layout.mirrors[index].outline_normalized)
        distance = shapely.distance(outline.exterior, shapely.points(seen))
        assert shapely.contains_xy(outline, seen[:, 0], seen[:, 1]).all()
        assert distance.min() * camera.fx_px > 0.9 * OUTLINE_MARGIN_PX
        # No more than the margin is lost: pixels 1 px further inside are kept.
        kept = layout.project(plane[weights == 0], index)
        kept = kept[((kept >= 0) & (kept <= inner)).all(axis=1)]
        seen = camera.normalized_from_pixels(kept)
        inside = shapely.contains_xy(outline, seen[:, 0], seen[:, 1])
        distance = shapely.distance(outline.exterior, shapely.points(seen[inside]))
        assert distance.max(initial=0.0) * camera.fx_px < OUTLINE_MARGIN_PX + 1.0


def test_nothing_is_sampled_where_nothing_is_valid(crooked: Decoder) -> None:
    camera = crooked.camera
    light_field = crooked.decode(np.full((camera.height_px, camera.width_px, 3), 200, np.uint8))
    assert (light_field.samples[light_field.valid] == 200).all()
    assert not light_field.samples[~light_field.valid].any()
    assert not light_field.valid.all()


def test_the_grid_is_chosen_from_the_layout(parabola_layout: Layout) -> None:
    common, union = Decoder(parabola_layout), Decoder(parabola_layout, field="union")
    assert common.views.reference_depth_mm == pytest.approx(375.0)  # harmonic mean of 300 and 500
    bare = parabola_layout.replaced(spec=None)
    assert Decoder(bare).views.reference_depth_mm == 400.0
    working, touching = (
        bare.replaced(metrics={"working_distance_mm": Metric(value=distance_mm, unit="mm")})
        for distance_mm in (300.0, 1.0)
    )
    middle = bare.camera.unproject(bare.outline_px(bare.central_index).mean(axis=0))
    seen = bare.mirrors[bare.central_index].reflect(300.0 * middle / np.linalg.norm(middle)) @ bare.view_from_rig.T
    assert Decoder(working).views.reference_depth_mm == pytest.approx(seen[2], rel=0.02)
    reach = max((mirror.outline_in_rig_mm @ bare.view_from_rig.T)[:, 2].max() for mirror in bare.mirrors)
    assert default_reference_depth_mm(touching) == pytest.approx(1.02 * reach, rel=0.02)
    assert common.views.focal_px == union.views.focal_px
    assert common.views.focal_px == pytest.approx(parabola_layout.camera.fx_px, rel=0.25)
    assert union.views.width_px > common.views.width_px
    assert union.views.height_px > common.views.height_px
    assert common.views.layout_identity == parabola_layout.identity
    # The field reaches its edges: every border of the common box is valid somewhere in the central view.
    central = common.weights[1, 1] > 0
    assert central[0].any()
    assert central[-1].any()
    assert central[:, 0].any()
    assert central[:, -1].any()


@pytest.mark.parametrize("width_px", [2, 77, 400])
def test_the_width_of_views_can_be_chosen(crooked_layout: Layout, width_px: int) -> None:
    own, chosen = Decoder(crooked_layout).views, Decoder(crooked_layout, width_px=width_px).views
    assert chosen.width_px == width_px
    # The same field, up to a pixel of either.
    for before, after in ((own.width_px, chosen.width_px), (own.height_px, chosen.height_px)):
        assert (after - 1) / chosen.focal_px <= before / own.focal_px
        assert after / chosen.focal_px >= (before - 1) / own.focal_px
    middle = [(np.array([each.width_px, each.height_px]) - 1) / 2 for each in (own, chosen)]
    found = [each.plane_points_in_rig(442.1, at) for each, at in zip((own, chosen), middle, strict=True)]
    assert np.allclose(found[0], found[1], atol=1e-6)


def test_the_common_field_is_seen_by_all_views(parabola_layout: Layout) -> None:
    decoder = Decoder(parabola_layout, reference_depth_mm=500.0)
    assert (decoder.weights > 0).all(axis=(0, 1)).mean() > 0.5
    assert (decoder.weights > 0).mean(axis=(2, 3)).min() > 0.7


def test_a_table_that_is_too_long_for_the_lookup_is_split(
    crooked: Decoder, crooked_layout: Layout, monkeypatch: pytest.MonkeyPatch
) -> None:
    frame = photographed(crooked_layout, 500.0, waves)
    whole = crooked.decode(frame)
    monkeypatch.setattr("mirrorcam.optics.light_field.decoder.MAX_TABLE_SIDE", crooked.views.height_px * 2 + 5)
    cut = Decoder(crooked_layout)
    assert len(cut.tables) == 3
    assert np.array_equal(cut.decode(frame).samples, whole.samples)


def test_grey_frames_decode_to_one_channel(crooked: Decoder, crooked_layout: Layout) -> None:
    frame = photographed(crooked_layout, 500.0, waves)
    grey = crooked.decode(np.ascontiguousarray(frame[..., 0]))
    assert grey.samples.shape[-1] == 1
    assert np.array_equal(grey.samples[..., 0], crooked.decode(frame).samples[..., 0])


def test_colours_that_a_lens_displaces_coincide_in_views(crooked: Decoder, crooked_layout: Layout) -> None:
    """Red is magnified by 0.2 %, blue by -0.1 %, about the principal point: up to 1 px."""
    camera = crooked_layout.camera
    frame = photographed(crooked_layout, 442.1, waves)[..., 0].astype(np.float32)
    factors = (1.002, 1.0, 0.999)
    colours = np.clip(np.stack([magnify(frame, camera, factor) for factor in factors], axis=-1), 0.0, 1.0)
    numbers = {"red": [0.002, 0.0], "blue": [-0.001, 0.0], "red_sigma": [0.0, 0.0], "blue_sigma": [0.0, 0.0]}
    corrected = Decoder(crooked_layout.replaced(camera=camera.replaced(lateral_colour=LateralColour(**numbers))))
    apart: dict[bool, float] = {}
    for decoder in (crooked, corrected):
        views = decoder.decode(np.ascontiguousarray(colours))
        valid = views.weights == 1.0
        difference = (views.samples[..., 0] - views.samples[..., 2])[valid]
        apart[decoder is corrected] = float(np.sqrt(np.mean(difference**2)))
    assert apart[True] < 0.15 * apart[False]
    grey = np.ascontiguousarray(colours[..., 1])
    np.testing.assert_array_equal(corrected.decode(grey).samples, crooked.decode(grey).samples)


def test_a_frame_with_negative_strides_decodes_to_the_same_values(crooked: Decoder) -> None:
    camera = crooked.camera
    bgr = np.random.default_rng(3).integers(0, 255, (camera.height_px, camera.width_px, 3), dtype=np.uint8)
    rgb = bgr[..., ::-1]
    assert np.array_equal(crooked.decode(rgb).samples, crooked.decode(np.ascontiguousarray(rgb)).samples)


def test_decoding_twice_gives_the_same_bytes_in_new_arrays(crooked: Decoder) -> None:
    camera = crooked.camera
    random = np.random.default_rng(5)
    frames = [random.integers(0, 255, (camera.height_px, camera.width_px, 3), dtype=np.uint8) for _ in range(2)]
    first = crooked.decode(frames[0])
    kept = first.samples.copy()
    crooked.decode(frames[1])
    assert np.array_equal(first.samples, kept)
    assert np.array_equal(crooked.decode(frames[0]).samples, kept)


@pytest.mark.parametrize(
    ("frame", "message"),
    [
        (np.zeros((480, 640, 3), np.uint8), "frame is 640x480 px, expected 960x600 of the layout's camera (crooked)"),
        (np.zeros((600, 960, 4), np.uint8), "frame has shape (600, 960, 4), expected (600, 960, 3) or (600, 960)"),
        (np.zeros((960,), np.uint8), "frame has shape (960,), expected (600, 960, 3) or (600, 960)"),
        (np.zeros((600, 960, 3), np.uint16), "frame is uint16, expected uint8, or float32 from 0 to 1"),
        (np.full((600, 960, 3), np.nan, np.float32), "frame has values from nan to nan, expected float32 from 0 to 1"),
        (np.full((600, 960), 255, np.float32), "frame has values from 255 to 255, expected float32 from 0 to 1"),
        (np.full((600, 960), -0.1, np.float32), "frame has values from -0.1 to -0.1, expected float32 from 0 to 1"),
    ],
)
def test_foreign_frames_are_refused(crooked: Decoder, frame: NDArray[np.uint8], message: str) -> None:
    with pytest.raises(InputError) as caught:
        crooked.decode(frame)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_layouts_that_cannot_be_decoded_are_refused(parabola_layout: Layout) -> None:
    mirrors = list(parabola_layout.mirrors)
    middle = mirrors[4].outline_in_rig_mm.mean(axis=0)
    small = middle + 0.1 * (mirrors[4].outline_in_rig_mm - middle)
    centre = mirrors[4].virtual_centre_in_rig_mm
    thick = Mirror.second_surface(centre, small, thickness_mm=9.0, refractive_index=1.49)
    with pytest.raises(InputError, match=r"^mirror 1-1 shows nothing: its plate is too thick for its size$"):
        Decoder(parabola_layout.replaced(mirrors=(*mirrors[:4], thick, *mirrors[5:])))
    with pytest.raises(InputError, match=r"^the plane at 5 mm lies nearer than mirror \d-\d, expected more than"):
        Decoder(parabola_layout, reference_depth_mm=5.0)
    with pytest.raises(InputError, match=r"^the plane at -7 mm lies nearer than mirror \d-\d, expected more than"):
        Decoder(parabola_layout, regular_grid_at_mm=-7.0)
    with pytest.raises(InputError, match=r"^reference_depth_mm: nan, expected a finite number$"):
        Decoder(parabola_layout, reference_depth_mm=float("nan"))
    with pytest.raises(InputError, match=r"^width_px: 1, expected 2 to 32766$"):
        Decoder(parabola_layout, width_px=1)
    with pytest.raises(
        InputError, match=r"^the common field would need 9000x\d+ px per view, more than the whole sensor$"
    ):
        Decoder(parabola_layout, width_px=9000)
    with pytest.raises(InputError, match=r"^the views have no common field at depth 120 mm, expected another"):
        Decoder(parabola_layout, reference_depth_mm=120.0)
    with pytest.raises(InputError, match=r"^the mirrors' order along s is reversed"):
        Decoder(parabola_layout.replaced(mirrors=tuple(mirrors[i] for i in (2, 1, 0, 5, 4, 3, 8, 7, 6))))
    with pytest.raises(InputError, match=r"^the mirrors' order along t is reversed"):
        Decoder(parabola_layout.replaced(mirrors=tuple(mirrors[i] for i in (6, 7, 8, 3, 4, 5, 0, 1, 2))))
    small = parabola_layout.camera.replaced(width_px=100, height_px=100)
    with pytest.raises(InputError, match=r"^mirror \d-\d lies outside the image"):
        Decoder(parabola_layout.replaced(camera=small))
    with pytest.raises(InputError, match=r"^mirror 0-0 does not look forward along the view axis$"):
        Decoder(parabola_layout.replaced(view_from_rig=np.diag([1.0, -1.0, -1.0])))


def test_diverging_views_have_no_useful_united_field(parabola_layout: Layout) -> None:
    mirrors = []
    for u, yaw in ((-0.3, 1.3), (0.3, -1.3)):
        looking = np.array([np.sin(yaw), np.cos(yaw), 0.0])
        corners = np.array([[-0.2, -0.2], [0.2, -0.2], [0.2, 0.2], [-0.2, 0.2]]) + np.array([u, 0.0])
        normal = looking - np.array([u, 0.0, 1.0]) / np.hypot(u, 1.0)
        middle = np.array([80.0 * u, 0.0, 80.0])
        rays = np.column_stack([corners, np.ones(4)])
        outline = rays * (middle @ normal / (rays @ normal))[:, None]
        mirrors.append(Mirror.from_plane(middle, normal, outline_in_rig_mm=outline))
    layout = Layout(rows=1, cols=2, camera=parabola_layout.camera, mirrors=tuple(mirrors))
    with pytest.raises(
        InputError, match=r"^the union field would need \d+x\d+ px per view, more than the whole sensor$"
    ):
        Decoder(layout, field="union")
    with pytest.raises(InputError, match=r"^the views have no common field at depth 400 mm"):
        Decoder(layout)


def test_the_light_field_names_its_layout(crooked: Decoder, crooked_layout: Layout) -> None:
    camera = crooked.camera
    light_field = crooked.decode(np.zeros((camera.height_px, camera.width_px, 3), np.uint8))
    assert isinstance(light_field, LightField)
    assert light_field.layout_identity == crooked_layout.identity
    assert np.array_equal(light_field.weights, crooked.weights)
