"""The layout: its file to the bit, its identity, its projections, and every refusal."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shapely import Point, Polygon

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import Metric
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import (
    FOLD_90_VIEW_FROM_RIG,
    Layout,
    Uncertainty,
    working_distance_mm,
    working_range_mm,
)
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.perturbations import draw_as_built
from mirrorcam.optics.geometry.tolerances import Tolerances

NAN = float("nan")


def load(tmp_path: Path, data: dict[str, Any]) -> Layout:
    path = tmp_path / "layout.json"
    path.write_text(json.dumps(data))
    return Layout.load(path)


def data_of(layout: Layout) -> dict[str, Any]:
    return dict(json.loads(layout.model_dump_json(by_alias=True, exclude_none=True)))


def full(layout: Layout) -> Layout:
    """The layout with every optional part."""
    return layout.replaced(
        kind="calibrated",
        metrics={"rms": Metric(value=0.05, unit="px", limit=0.1)},
        verdict={"smallest_gap_mm": Metric(value=1.2, unit="mm", limit=1.0, lower_is_better=False)},
        provenance={"made by": "a test"},
        uncertainty=Uncertainty(parameters=("fx_px", "mirror 0 x_mm"), covariance=[[0.1, 0.01], [0.01, 1 / 3]]),
    )


@pytest.mark.parametrize("which", ["parabola_layout", "crooked_layout"])
def test_a_layout_survives_its_file_to_the_bit(which: str, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    layout = full(request.getfixturevalue(which))
    layout.save(tmp_path / "layout.json")
    back = Layout.load(tmp_path / "layout.json")
    assert back == layout
    assert back.identity == layout.identity
    assert back.virtual_centres_in_rig_mm.tobytes() == layout.virtual_centres_in_rig_mm.tobytes()
    for ours, theirs in zip(layout.mirrors, back.mirrors, strict=True):
        assert ours.outline_in_rig_mm.tobytes() == theirs.outline_in_rig_mm.tobytes()
    back.save(tmp_path / "again.json")
    assert (tmp_path / "again.json").read_bytes() == (tmp_path / "layout.json").read_bytes()


def test_the_file_names_its_schema_and_its_units(parabola_layout: Layout) -> None:
    data = data_of(parabola_layout)
    assert data["schema"] == "mirrorcam.layout/1"
    assert set(data["mirrors"][0]) == {
        "virtual_centre_in_rig_mm",
        "outline_in_rig_mm",
        "surface",
        "thickness_mm",
        "refractive_index",
    }
    assert "uncertainty" not in data


def test_identity_changes_with_light_and_with_nothing_else(crooked_layout: Layout) -> None:
    layout, camera, mirrors = crooked_layout, crooked_layout.camera, list(crooked_layout.mirrors)
    assert len(layout.identity) == 16
    assert set(layout.identity) <= set("0123456789abcdef")
    alike = [
        full(layout),
        layout.replaced(spec=None),
        layout.replaced(spec=DesignSpec(rows=4)),
        layout.replaced(kind="nominal"),
        layout.replaced(camera=camera.replaced(name="another name")),
    ]
    assert {other.identity for other in alike} == {layout.identity}
    turned = np.array(FOLD_90_VIEW_FROM_RIG)[[1, 2, 0]]
    different = [
        layout.replaced(camera=camera.replaced(fx_px=camera.fx_px + 1e-9)),
        layout.replaced(camera=camera.replaced(width_px=camera.width_px + 1)),
        layout.replaced(camera=camera.with_intrinsics(camera.intrinsics + np.eye(9)[8] * 1e-12)),
        layout.replaced(mirrors=(mirrors[0].moved(np.eye(3), np.array([1e-9, 0, 0])), *mirrors[1:])),
        layout.replaced(mirrors=(mirrors[0].replaced(surface="second"), *mirrors[1:])),
        layout.replaced(mirrors=tuple(reversed(mirrors))),
        layout.replaced(rows=3, cols=2),
        layout.replaced(view_from_rig=turned),
    ]
    assert len({other.identity for other in [layout, *different]}) == 1 + len(different)


def test_only_a_designed_layout_has_its_spec(default_layout: Layout) -> None:
    assert default_layout.replaced(spec=DesignSpec()).designed_spec == DesignSpec()
    with pytest.raises(ValueError, match="expected one that was designed"):
        _ = default_layout.replaced(spec=None).designed_spec


def test_mirrors_stand_row_by_row_from_the_highest_and_left_to_right(parabola_layout: Layout) -> None:
    centres = parabola_layout.virtual_centres_in_rig_mm.reshape(3, 3, 3)
    assert (np.diff(centres[:, :, 2], axis=0) < 0).all()  # z_rig is up, t is down
    assert (np.diff(centres[:, :, 0], axis=1) > 0).all()
    in_view = parabola_layout.virtual_centres_in_view_mm
    assert in_view.shape == (3, 3, 3)
    assert np.allclose(in_view[..., 0], centres[..., 0])
    assert np.allclose(in_view[..., 1], -centres[..., 2])
    assert np.allclose(in_view[..., 2], centres[..., 1])
    assert np.allclose(in_view[..., 2], -80.0)  # the directrix plane of the parabola


@pytest.mark.parametrize(
    ("rows", "cols", "central"), [(3, 3, 4), (2, 3, 4), (1, 2, 1), (4, 4, 10), (1, 1, 0), (5, 1, 2)]
)
def test_the_central_mirror(rows: int, cols: int, central: int, parabola_layout: Layout) -> None:
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * 0.01
    template = parabola_layout.mirrors[4]
    mirrors = tuple(
        template.replaced(outline_in_rig_mm=template.intersect(corners + 0.03 * np.array([col, row])))
        for row in range(rows)
        for col in range(cols)
    )
    layout = Layout(rows=rows, cols=cols, camera=parabola_layout.camera, mirrors=mirrors)
    assert layout.central_index == central


@pytest.mark.parametrize("which", ["parabola_layout", "crooked_layout"])
def test_it_projects_as_a_mirrored_pinhole_at_the_virtual_centre(which: str, request: pytest.FixtureRequest) -> None:
    layout: Layout = request.getfixturevalue(which)
    points = np.random.default_rng(0).uniform([-30, 300, 50], [30, 900, 130], (40, 3))
    for index, mirror in enumerate(layout.mirrors):
        rays = (points - mirror.virtual_centre_in_rig_mm) @ mirror.reflection.T
        expected = layout.camera.pixels_from_normalized(rays[:, :2] / rays[:, 2:])
        assert np.abs(layout.project(points, index) - expected).max() < 1e-9


def test_sub_images_lie_apart_on_the_sensor_and_follow_the_lens(crooked_layout: Layout) -> None:
    polygons = [Polygon(crooked_layout.outline_px(index)) for index in range(6)]
    assert all(polygon.is_valid for polygon in polygons)
    assert all(not a.intersects(b) for i, a in enumerate(polygons) for b in polygons[i + 1 :])
    mirror = crooked_layout.mirrors[0]
    sampled = crooked_layout.outline_px(0, points_per_edge=8)
    assert sampled.shape == (32, 2)
    assert np.allclose(sampled[::8], crooked_layout.camera.project(mirror.outline_in_rig_mm))
    middle = (mirror.outline_normalized[0] + mirror.outline_normalized[1]) / 2
    assert np.allclose(sampled[4], crooked_layout.camera.pixels_from_normalized(middle))


def _with(data: dict[str, Any], path: list[Any], value: Any) -> dict[str, Any]:
    where = data
    for key in path[:-1]:
        where = where[key]
    where[path[-1]] = value
    return data


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (["schema"], "mirrorcam.layout/2", "schema: 'mirrorcam.layout/2', expected 'mirrorcam.layout/1'"),
        (["cols_"], 3, "cols_: not known, did you mean cols?"),
        (["camera", "skew"], 0.0, "camera.skew: not known"),
        (["camera", "fx_px"], NAN, "camera.fx_px: Input should be a finite number"),
        (["camera", "fx_px"], -3.0, "camera.fx_px: Input should be greater than or equal to 0.001"),
        (
            ["camera", "distortion"],
            [0, 0, 0, 0],
            "camera.distortion: 4 distortion coefficients, expected 5",
        ),
        (["kind"], "measured", "kind: Input should be 'nominal', 'as-built' or 'calibrated'"),
        (["rows"], 2, "9 mirrors, expected rows x cols = 6"),
        (["rows"], -1, "rows: Input should be greater than or equal to 0"),
        (["rows"], 0, "9 mirrors, expected rows x cols = 0"),
        (["mirrors"], [], "0 mirrors, expected rows x cols = 9"),
        (
            ["mirrors", 4, "virtual_centre_in_rig_mm"],
            [0.0, NAN, 80.0],
            "mirrors.4.virtual_centre_in_rig_mm: holds a value",
        ),
        (["mirrors", 4, "virtual_centre_in_rig_mm"], [0.0, 80.0], "shape (2,), expected (3)"),
        (["mirrors", 4, "virtual_centre_in_rig_mm"], [0, -80, 81], "mirrors.4: outline leaves the mirror plane"),
        (["mirrors", 4, "outline_in_rig_mm", 0], [0.0, 0.0], "mirrors.4.outline_in_rig_mm: not an array of numbers"),
        (["mirrors", 4, "outline_in_rig_mm"], [], "mirrors.4.outline_in_rig_mm: shape (0,), expected (n, 3)"),
        (["mirrors", 4, "surface"], "third", "mirrors.4.surface: Input should be 'first' or 'second'"),
        (["view_from_rig"], [[1, 0, 0], [0, 1, 0], [0, 0, -1]], "view_from_rig is not a rotation"),
        (["view_from_rig"], [[2, 0, 0], [0, 1, 0], [0, 0, 1]], "view_from_rig is not a rotation"),
        (["spec", "rows"], 13, "spec.rows: Input should be less than or equal to 12"),
        (["metrics"], {"rms": {"value": NAN, "unit": "px"}}, "metrics.rms.value: Input should be a finite number"),
        (["uncertainty"], {"parameters": ["fx_px"], "covariance": [[1, 0], [0, 1]]}, "covariance has shape (2, 2)"),
    ],
)
def test_files_are_refused_by_name_in_one_line(
    path: list[Any], value: Any, message: str, tmp_path: Path, parabola_layout: Layout
) -> None:
    with pytest.raises(InputError) as caught:
        load(tmp_path, _with(data_of(parabola_layout), path, value))
    line = str(caught.value)
    assert "\n" not in line
    assert line.startswith(f"{tmp_path / 'layout.json'}: ")
    assert message in line


def _outline(mirror: Mirror, order: list[int]) -> list[list[float]]:
    return [list(map(float, mirror.outline_in_rig_mm[index])) for index in order]


def test_crossing_dented_and_overlapping_outlines_are_refused(tmp_path: Path, parabola_layout: Layout) -> None:
    mirrors, place = parabola_layout.mirrors, ["mirrors", 4, "outline_in_rig_mm"]
    with pytest.raises(InputError, match=r"mirrors\.4: outline crosses itself, expected a convex polygon"):
        load(tmp_path, _with(data_of(parabola_layout), place, _outline(mirrors[4], [0, 2, 1, 3])))
    dent = mirrors[4].intersect(np.array([[-0.1, -0.1], [0.1, -0.1], [0.0, 0.0], [0.1, 0.1], [-0.1, 0.1]])).tolist()
    with pytest.raises(InputError, match=r"mirrors\.4: outline is not convex, expected a convex polygon"):
        load(tmp_path, _with(data_of(parabola_layout), place, dent))
    wide = mirrors[4].intersect(np.array([[-0.3, -0.1], [0.1, -0.1], [0.1, 0.1], [-0.3, 0.1]])).tolist()
    with pytest.raises(InputError, match=r"outlines of mirrors 1-0 and 1-1 overlap in the image, expected a gap"):
        load(tmp_path, _with(data_of(parabola_layout), place, wide))
    inside = mirrors[3].intersect(0.5 * mirrors[4].outline_normalized).tolist()
    with pytest.raises(InputError, match=r"outlines of mirrors 1-0 and 1-1 overlap in the image"):
        load(tmp_path, _with(data_of(parabola_layout), ["mirrors", 3, "outline_in_rig_mm"], inside))


@pytest.mark.parametrize("kind", ["as-built", "calibrated"])
def test_a_device_may_hide_a_sliver_that_a_design_may_not(parabola_layout: Layout, kind: str) -> None:
    def grown(by: float) -> tuple[Mirror, ...]:
        outline = parabola_layout.mirrors[4].outline_normalized.copy()
        outline[outline[:, 0] < 0, 0] -= by
        cut = parabola_layout.mirrors[4].replaced(outline_in_rig_mm=parabola_layout.mirrors[4].intersect(outline))
        return (*parabola_layout.mirrors[:4], cut, *parabola_layout.mirrors[5:])

    width = float(np.ptp(parabola_layout.mirrors[4].outline_normalized[:, 0]))
    gap = -float(
        parabola_layout.mirrors[3].outline_normalized[:, 0].max()
        - parabola_layout.mirrors[4].outline_normalized[:, 0].min()
    )
    sliver, slice_of = grown(gap + 0.01 * width), grown(gap + 0.04 * width)
    assert parabola_layout.replaced(kind=kind, mirrors=sliver).mirrors == sliver
    for wrong in ({"kind": kind, "mirrors": slice_of}, {"kind": "nominal", "mirrors": sliver}):
        with pytest.raises(ValueError, match="outlines of mirrors 1-0 and 1-1 overlap in the image"):
            parabola_layout.replaced(**wrong)


def test_a_file_that_breaks_off_or_is_missing_is_refused(tmp_path: Path, parabola_layout: Layout) -> None:
    path = tmp_path / "layout.json"
    parabola_layout.save(path)
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(InputError, match=r"layout\.json: not valid JSON: "):
        Layout.load(path)
    with pytest.raises(InputError, match=r"none\.json: no such file$"):
        Layout.load(tmp_path / "none.json")
    with pytest.raises(InputError, match=r"is a folder, expected a file$"):
        Layout.load(tmp_path)


def test_second_surface_mirrors_are_seen_where_they_look(parabola_layout: Layout) -> None:
    second = tuple(
        Mirror.second_surface(m.virtual_centre_in_rig_mm, m.outline_in_rig_mm, thickness_mm=3.0, refractive_index=1.49)
        for m in parabola_layout.mirrors
    )
    behind = parabola_layout.replaced(mirrors=second)
    assert np.allclose(behind.virtual_centres_in_rig_mm, parabola_layout.virtual_centres_in_rig_mm, atol=1e-9)
    assert np.allclose(behind.virtual_centres_in_view_mm, parabola_layout.virtual_centres_in_view_mm, atol=1e-9)
    assert np.allclose(behind.outline_px(4), parabola_layout.outline_px(4), atol=1e-6)
    points = np.array([[10.0, 400.0, 70.0], [-20.0, 600.0, 110.0]])
    # Exact through the glass: close to the apparent mirror's images, but not equal.
    found, plain = behind.project(points, 0), parabola_layout.project(points, 0)
    assert 0.1 < np.abs(found - plain).max() < 0.5
    assert np.allclose(found, behind.camera.project(second[0].image_of(points)), atol=1e-12)
    assert behind.identity != parabola_layout.identity


def test_a_layout_drawn_around_another_has_no_verdict(parabola_layout: Layout) -> None:
    judged = full(parabola_layout.replaced(uncertainty=None))
    assert judged.verdict
    drawn = draw_as_built(judged, Tolerances(), np.random.default_rng(1))
    assert drawn.verdict == {}
    assert drawn.metrics == {}


def test_mirrors_are_named_by_row_and_column(default_layout: Layout) -> None:
    assert default_layout.mirror_names[:4] == ("0-0", "0-1", "0-2", "1-0")
    assert default_layout.mirror_names[default_layout.central_index] == "1-1"
    pair = default_layout.replaced(rows=1, cols=2, mirrors=default_layout.mirrors[:2])
    assert pair.mirror_names == ("0-0", "0-1")


def test_boards_come_before_the_design_and_the_range_holds_both(parabola_layout: Layout) -> None:
    assert parabola_layout.spec is not None
    low, high = min(parabola_layout.spec.depths_mm), max(parabola_layout.spec.depths_mm)
    bare = parabola_layout.replaced(spec=None, metrics={})
    plain, calibrated = (
        layout.replaced(metrics={"working_distance_mm": Metric(value=100.0, unit="mm")})
        for layout in (bare, parabola_layout)
    )
    assert working_distance_mm(bare) is None
    assert working_range_mm(bare) is None
    assert working_range_mm(parabola_layout) == (low, high)
    assert working_distance_mm(plain) == working_distance_mm(calibrated) == 100.0
    assert working_range_mm(plain) == pytest.approx((70.0, 140.0))
    assert working_range_mm(calibrated) == pytest.approx((70.0, high))


def test_a_layout_without_mirrors_is_no_layout_file(tmp_path: Path) -> None:
    bare = Layout.bare(Camera.c920())
    assert bare.mirrors == () and bare.virtual_centres_in_rig_mm.shape == (0, 3)
    bare.save(tmp_path / "layout.json")
    with pytest.raises(InputError, match="no mirrors, expected a layout with 1 x 1 or more"):
        Layout.load(tmp_path / "layout.json")


def test_a_mirror_is_named_or_numbered(default_layout: Layout) -> None:
    point = np.array([0.0, 0.0, 450.0]) @ default_layout.view_from_rig
    last = len(default_layout.mirrors) - 1
    name = default_layout.mirror_names[last]
    assert (default_layout.project(point, name) == default_layout.project(point.tolist(), last)).all()
    for wrong in ("9-9", last + 1, -1):
        with pytest.raises(InputError, match=rf"^mirror {wrong!r}, expected one of "):
            default_layout.project(point, wrong)


def test_pixels_outside_the_sub_image_or_the_frame_show_nothing(default_layout: Layout) -> None:
    for index in range(len(default_layout.mirrors)):
        outline = default_layout.outline_px(index)
        middle = outline.mean(axis=0)
        pixels = np.stack([middle, 2.0 * outline[0] - middle, [np.nan, np.nan]])
        assert default_layout.shows(pixels, index).tolist() == [True, False, False]
    # A mirror of twice the size reaches beyond the frame.
    mirror = default_layout.mirrors[0]
    point, normal = mirror.outline_in_rig_mm.mean(axis=0), mirror.normal_in_rig
    larger = Mirror.from_plane(point, normal, outline_in_plane_mm=4.0 * mirror.outline_in_plane_mm)
    alone = default_layout.replaced(rows=1, cols=1, mirrors=(larger,), spec=None)
    outside = np.array([-10.0, default_layout.camera.height_px / 2.0])
    assert Polygon(alone.outline_px(0)).contains(Point(outside))
    assert not alone.shows(outside, 0)


def test_layouts_of_version_0_2_0_are_read_as_free_outlines(default_layout: Layout, tmp_path: Path) -> None:
    stored = default_layout.model_dump(mode="json", by_alias=True)
    del stored["spec"]["shape"]
    (tmp_path / "layout.json").write_text(json.dumps(stored))
    spec = Layout.load(tmp_path / "layout.json").spec
    assert spec is not None
    assert spec.shape == "free"
