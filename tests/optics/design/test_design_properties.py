"""Properties of designs for random specs; damage to a design is always detected and named."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.design.assess.chief_rays import Occlusion, blocked_light, sampled, traced
from mirrorcam.optics.design.assess.layout_metrics import evaluate
from mirrorcam.optics.design.assess.verify import verify
from mirrorcam.optics.design.optimise import design
from mirrorcam.optics.design.program.seeds import faceted_parabola
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec, InfeasibleDesign
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.mirror_gaps import sub_images_closer_than

CAMERAS = (
    Camera.c920(),
    Camera.c920().replaced(distortion=[-0.1, 0.02, 0.001, -0.001, 0.0], cx_px=940.0, cy_px=560.0),
    Camera(name="640x480 webcam", width_px=640, height_px=480, fx_px=600.0, fy_px=605.0, cx_px=322.0, cy_px=236.0),
)


def specs(counts: list[tuple[int, int]]) -> st.SearchStrategy[DesignSpec]:
    """Specs over the parameters that designers vary; most have a layout."""

    def made(
        count: tuple[int, int],
        scale_mm: float,
        fold_deg: float,
        depths: tuple[float, ...],
        spacing: float,
        tradeoff: float,
        camera: Camera,
    ) -> DesignSpec:
        return DesignSpec(
            rows=count[0],
            cols=count[1],
            scale_mm=scale_mm,
            fold_deg=fold_deg,
            depths_mm=tuple(round(scale_mm * depth, 1) for depth in depths),
            spacing_mm=round(spacing, 2),
            tradeoff=round(tradeoff, 2),
            camera=camera,
        )

    depths = st.sampled_from([(4.0,), (3.0, 6.0), (2.5, 5.0, 12.0)])
    return st.builds(
        made,
        st.sampled_from(counts),
        st.floats(40.0, 200.0).map(lambda scale: round(scale, 1)),
        st.sampled_from([90.0, 105.0, 120.0]),
        depths,
        st.floats(0.0, 3.0),
        st.floats(0.0, 1.0),
        st.sampled_from(CAMERAS),
    )


def assert_stands(spec: DesignSpec) -> None:
    """A design contains its passing verdict and figures, as measured again; or it is refused in one line."""
    try:
        layout = design(spec)
    except InfeasibleDesign as refusal:
        assert "\n" not in str(refusal)
        assert refusal.constraint
        return
    assert layout.verdict == verify(layout, spec)
    assert [name for name, metric in layout.verdict.items() if not metric.passed] == []
    assert layout.metrics == evaluate(layout, spec.depths_mm)
    assert Layout.model_validate_json(layout.model_dump_json(by_alias=True)).verdict == layout.verdict


@pytest.mark.slow
@settings(max_examples=4)
@given(specs([(1, 2), (2, 1), (2, 2)]))
def test_small_designs_carry_a_passing_verdict(spec: DesignSpec) -> None:
    assert_stands(spec)


@pytest.mark.slow
@settings(max_examples=40, suppress_health_check=[HealthCheck.too_slow])
@given(specs([(1, 2), (2, 2), (2, 3), (3, 3), (2, 4), (3, 5), (4, 4)]))
def test_designs_of_any_size_carry_a_passing_verdict(spec: DesignSpec) -> None:
    assert_stands(spec)


@cache
def sound(rows: int, cols: int) -> tuple[Layout, DesignSpec]:
    """A layout that meets its spec except for the overlap of its views, which is not damaged here."""
    spec = DesignSpec(
        rows=rows, cols=cols, fold_deg=90.0, spacing_mm=0.5, min_edge_mm=0.0, min_area_mm2=0.0, shape="free"
    )
    return faceted_parabola(spec), spec


def failed(layout: Layout, spec: DesignSpec) -> set[str]:
    return {name for name, metric in verify(layout, spec).items() if not metric.passed}


def damaged(layout: Layout, index: int, mirror: Mirror) -> Layout:
    return layout.replaced(mirrors=(*layout.mirrors[:index], mirror, *layout.mirrors[index + 1 :]))


def scaled(mirror: Mirror, along: float) -> Mirror:
    """The mirror with the same sub-image at another distance."""
    return mirror.replaced(
        virtual_centre_in_rig_mm=mirror.virtual_centre_in_rig_mm * along,
        outline_in_rig_mm=mirror.outline_in_rig_mm * along,
    )


SIZES = st.sampled_from([(2, 2), (2, 3), (3, 3), (4, 4)])


@given(SIZES)
def test_the_start_is_sound(size: tuple[int, int]) -> None:
    assert {name for name in failed(*sound(*size)) if not name.startswith("common_area")} == set()


@given(SIZES, st.integers(0, 11), st.booleans(), st.floats(0.2, 200.0))
def test_a_mirror_that_leaves_the_sensor_is_named(size: tuple[int, int], row: int, right: bool, out_px: float) -> None:
    layout, spec = sound(*size)
    index = row % spec.rows * spec.cols + (spec.cols - 1 if right else 0)
    mirror, side = layout.mirrors[index], 1.0 if right else -1.0
    corners = mirror.outline_normalized.copy()
    corners[np.argsort(side * corners[:, 0])[-2:], 0] += side * out_px / layout.camera.fx_px
    broken = damaged(layout, index, mirror.replaced(outline_in_rig_mm=mirror.intersect(corners)))
    assert "outside_sensor_px" in failed(broken, spec)
    assert verify(broken, spec)["outside_sensor_px"].value == pytest.approx(out_px, abs=0.1)


@given(SIZES, st.data())
def test_a_mirror_in_the_light_of_another_is_named(size: tuple[int, int], data: st.DataObject) -> None:
    # A mirror of an upper row that moves towards the pupil enters the light leaving the mirror below it.
    layout, spec = sound(*size)
    index = data.draw(st.integers(0, (spec.rows - 1) * spec.cols - 1))
    broken = damaged(layout, index, scaled(layout.mirrors[index], data.draw(st.floats(0.4, 0.7))))
    assert "blocked_light" in failed(broken, spec)


@pytest.mark.slow
@given(SIZES, st.floats(0.01, 5.0))
def test_mirrors_too_close_are_named(size: tuple[int, int], more_mm: float) -> None:
    layout, spec = sound(*size)
    found = verify(layout, spec.replaced(spacing_mm=spec.spacing_mm + more_mm))["smallest_gap_mm"]
    assert not found.passed
    assert found.value == pytest.approx(spec.spacing_mm, abs=1e-3)


@pytest.mark.slow
@given(SIZES, st.data(), st.floats(0.0, 0.99))
def test_a_sub_image_that_reaches_for_another_is_named(size: tuple[int, int], data: st.DataObject, part: float) -> None:
    layout, spec = sound(*size)
    gap = spec.seen_gap_mm / spec.scale_mm
    row, col = data.draw(st.integers(0, spec.rows - 1)), data.draw(st.integers(0, spec.cols - 2))
    index = row * spec.cols + col
    mirror, neighbour = layout.mirrors[index], layout.mirrors[index + 1]
    corners = mirror.outline_normalized.copy()
    nearest = neighbour.outline_normalized[:, 0].min()
    corners[np.argsort(corners[:, 0])[-2:], 0] = nearest - part * gap
    broken = damaged(layout, index, mirror.replaced(outline_in_rig_mm=mirror.intersect(corners)))
    assert "smallest_seen_gap_mm" in failed(broken, spec)
    found = verify(broken, spec)["smallest_seen_gap_mm"].value
    assert found == pytest.approx(part * spec.seen_gap_mm, abs=1e-6)
    assert [(index, index + 1)] == sub_images_closer_than(broken.mirrors, gap)


@given(st.sampled_from([(1, 2), (2, 1)]), st.integers(0, 1), st.floats(0.05, 0.45))
def test_a_mirror_moved_against_the_other_is_too_close(size: tuple[int, int], index: int, by_mm: float) -> None:
    layout, spec = sound(*size)
    mirror, other = layout.mirrors[index], layout.mirrors[1 - index]
    direction = other.outline_in_rig_mm.mean(axis=0) - mirror.outline_in_rig_mm.mean(axis=0)
    direction -= (direction @ mirror.normal_in_rig) * mirror.normal_in_rig
    broken = damaged(layout, index, mirror.moved(np.eye(3), by_mm * direction / np.linalg.norm(direction)))
    assert "smallest_gap_mm" in failed(broken, spec)


def hit_by_triangles(mirror: Mirror, other: Mirror, depth_mm: float, steps: int) -> dict[str, float]:
    """Part of a first-surface mirror's light that meets the surface of another, cut into triangles (Moeller, Trumbore).

    Bodies are solid and no ray starts in another, so that light is stopped exactly where it meets the skin.
    """
    front = other.outline_in_rig_mm
    back = front - other.thickness_mm * other.normal_in_rig
    count = len(front)
    fans = [(face[0], face[k], face[k + 1]) for face in (front, back) for k in range(1, count - 1)]
    walls = [
        triangle
        for k in range(count)
        for triangle in (
            (front[k], front[(k + 1) % count], back[k]),
            (back[k], back[(k + 1) % count], front[(k + 1) % count]),
        )
    ]
    met, _, directions = traced(mirror, sampled(mirror.usable_normalized, steps))
    forward = directions[:, 1] > 1e-9
    met, directions = met[forward], directions[forward]
    beyond = directions * ((depth_mm - met[:, 1]) / directions[:, 1])[:, None]
    return {
        leg: float(np.mean(np.any([_meets(starts, ways, *triangle) for triangle in fans + walls], axis=0)))
        for leg, starts, ways in (("in", np.zeros_like(met), met), ("out", met, beyond))
    }


def _meets(starts: FloatArray, ways: FloatArray, a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    normal = np.cross(ways, c - a)
    scale = normal @ (b - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = np.sum((starts - a) * normal, axis=1) / scale
        across = np.cross(starts - a, b - a)
        v, along = np.sum(ways * across, axis=1) / scale, across @ (c - a) / scale
    return (u >= 0) & (v >= 0) & (u + v <= 1) & (along > 0) & (along < 1)


@settings(max_examples=15)
@given(SIZES, st.integers(0, 2**31))
def test_rays_agree_with_triangles(size: tuple[int, int], seed: int) -> None:
    layout, _ = sound(*size)
    random = np.random.default_rng(seed)
    mirrors = [
        scaled(mirror, random.uniform(0.8, 1.2)).replaced(thickness_mm=random.uniform(0.3, 6.0))
        for mirror in layout.mirrors
    ]
    found: dict[tuple[int, int, str], Occlusion] = {
        (one.mirror, one.occluder, one.leg): one for one in blocked_light(mirrors, 500.0, 10)
    }
    for lit, occluder in random.integers(0, len(mirrors), (8, 2)).tolist():
        if lit == occluder:
            continue
        for leg, fraction in hit_by_triangles(mirrors[lit], mirrors[occluder], 500.0, 10).items():
            mine = found.get((lit, occluder, leg))
            # A ray along an edge may count or not.
            assert (mine.fraction if mine else 0.0) == pytest.approx(fraction, abs=0.03)
