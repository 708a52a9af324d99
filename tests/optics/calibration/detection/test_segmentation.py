"""Outlines found where the picture changes, against those of the mirrors that made it."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from pydantic import ValidationError

from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.detection.segmentation import Extremes, _with_edges, outlined, seen_edges
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from tests.optics.layouts import faceted_parabola

PINHOLE = Camera(width_px=1920, height_px=1080, fx_px=1360.0, fy_px=1360.0, cx_px=959.5, cy_px=539.5)
CAMERA = PINHOLE.replaced(distortion=[0.05, -0.1, 0.0, 0.0, 0.0])
MEANT = faceted_parabola(CAMERA, DesignSpec(camera=CAMERA, rows=2, cols=2), fill=0.9).replaced(kind="calibrated")
FINE = 4  # parts of a pixel to which outlines are drawn


def cut_and_glued(mirror: Mirror, scale: tuple[float, float], by_mm: tuple[float, float], turn_deg: float) -> Mirror:
    """The mirror in its own plane: cut smaller, shifted, turned."""
    turn = np.radians(turn_deg)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    outline = mirror.outline_in_plane_mm * scale @ rotation.T + by_mm
    frame = mirror.rig_from_plane
    return mirror.replaced(outline_in_rig_mm=frame[:3, 3] + outline @ frame[:3, :2].T)


SLIPS = [
    ((0.97, 0.98), (0.3, -0.3), 0.4),
    ((0.98, 0.96), (-0.3, 0.2), -0.3),
    ((0.96, 0.98), (0.2, 0.3), 0.2),
    ((1.0, 1.0), (0.0, 0.0), 0.0),
]
BUILT = MEANT.replaced(
    mirrors=tuple(cut_and_glued(mirror, *slip) for mirror, slip in zip(MEANT.mirrors, SLIPS, strict=True))
)


def worst_px(layout: Layout, index: int) -> float:
    """How far corners of the outline are from those as built, at most; of those on the sensor."""
    true, found = BUILT.outline_px(index, 1), layout.outline_px(index, 1)
    on_sensor = ((true > 2) & (true < [1917, 1077])).all(axis=1)
    assert on_sensor.sum() >= 3
    return float(np.linalg.norm(found - true, axis=1)[on_sensor].max())


def masks(of: Layout) -> list[NDArray[np.float32]]:
    """How much of each pixel (h, w) each sub-image covers."""
    drawn = []
    for index, mirror in enumerate(of.mirrors):
        if mirror.is_second_surface:
            drawn.append(traced(mirror))
            continue
        canvas = np.zeros((1080 * FINE, 1920 * FINE), np.uint8)
        corners = np.rint((of.outline_px(index) + 0.5) * FINE - 0.5).astype(np.int32)
        filled = cv2.fillPoly(canvas, [corners], (255,))
        small = cv2.resize(filled, (1920, 1080), interpolation=cv2.INTER_AREA)
        drawn.append(np.asarray(small, dtype=np.float32) / np.float32(255.0))
    return drawn


def traced(mirror: Mirror) -> NDArray[np.float32]:
    """Which pixels (h, w) show the scene by light that enters and leaves through the front, by Snell's law."""
    x, y = np.meshgrid(np.arange(1920.0), np.arange(1080.0))
    rays = np.stack([(x - 959.5) / 1360.0, (y - 539.5) / 1360.0, np.ones_like(x)], axis=-1).reshape(-1, 3)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    normal = mirror.normal_in_rig
    inwards = -rays @ normal
    at = rays * ((mirror.distance_mm - mirror.thickness_mm) / inwards)[:, None]
    across = (rays + inwards[:, None] * normal) / mirror.refractive_index
    out = at + 2.0 * mirror.thickness_mm * across / np.sqrt(1.0 - np.sum(across**2, axis=1, keepdims=True))
    axes, middle = mirror.rig_from_plane[:3, :2], mirror.rig_from_plane[:3, 3]
    front = shapely.Polygon(mirror.outline_in_plane_mm)
    shapely.prepare(front)
    inside = [shapely.contains_xy(front, *((points - middle) @ axes).T) for points in (at, out)]
    return np.asarray(np.logical_and(*inside).reshape(1080, 1920), dtype=np.float32)


def frames(count: int, layout: Layout = BUILT, *, inner: Layout | None = None) -> list[Grey]:
    """Patches of random brightness in each sub-image, blurred by a lens, on a holder that reflects a little.

    With `inner`, patches of every other frame end where those sub-images do.
    """
    random = np.random.default_rng(3)

    outer = masks(layout)
    by_turns = [outer, outer if inner is None else masks(inner)]
    pictures = []
    for number in range(count):
        light: NDArray[np.float32] = np.full((1080, 1920), 20.0, np.float32)
        for mask in by_turns[number % 2]:
            patches = random.choice([30.0, 200.0], (27, 48)).astype(np.float32)
            shown = cv2.resize(patches, (1920, 1080), interpolation=cv2.INTER_NEAREST)
            light = np.asarray(light + mask * (shown - light), dtype=np.float32)
        light = np.asarray(cv2.GaussianBlur(light, (0, 0), 1.0), dtype=np.float32)
        light += random.normal(0.0, 2.0, light.shape).astype(np.float32)
        pictures.append(np.clip(np.rint(light), 0, 255).astype(np.uint8))
    return pictures


def seen_in(pictures: list[Grey]) -> Extremes:
    extremes = Extremes()
    for picture in pictures:
        extremes.add(picture)
    return extremes


def _outlined(layout: Layout, extremes: Extremes) -> tuple[Layout, tuple[str, ...]]:
    return outlined(layout, seen_edges(layout, extremes))


def test_mirrors_cut_and_glued_elsewhere_get_the_outlines_that_are_seen() -> None:
    found, notes = _outlined(MEANT, seen_in(frames(12)))
    for index in range(3):
        assert worst_px(MEANT, index) > 8.0
        assert worst_px(found, index) < 1.0
        assert np.array_equal(
            found.mirrors[index].virtual_centre_in_rig_mm, MEANT.mirrors[index].virtual_centre_in_rig_mm
        )
    assert len(notes) == 3
    assert all(
        f"mirror {name}: " in note and "moved there" in note
        for name, note in zip(MEANT.mirror_names, notes, strict=False)
    )
    # As it was meant, and seen there: not moved by what a blurred edge leaves open.
    assert found.mirrors[3] == MEANT.mirrors[3]


def test_where_a_board_ends_the_mirror_does_not() -> None:
    frames_of_boards = frames(8, MEANT, inner=BUILT)
    assert _outlined(MEANT, seen_in(frames_of_boards)) == (MEANT, ())
    assert _outlined(MEANT, seen_in(frames_of_boards[1::2]))[1], "the boards' own ends would be believed"


def test_where_nothing_changes_nothing_is_moved() -> None:
    assert _outlined(MEANT, Extremes()) == (MEANT, ())
    assert _outlined(MEANT, seen_in([np.full((1080, 1920), 90, np.uint8)] * 5)) == (MEANT, ())
    assert _outlined(MEANT, seen_in(frames(3))) == (MEANT, ())


def widened(layout: Layout, index: int, *, left_px: float = 0.0, right_px: float = 0.0) -> Layout:
    """The layout with one mirror wider on the sensor."""
    mirror, corners = layout.mirrors[index], layout.outline_px(index, 1)
    corners[:, 0] += np.where(corners[:, 0] < corners[:, 0].mean(), -left_px, right_px)
    outline = mirror.cut(layout.camera.normalized_from_pixels(corners))
    return layout.replaced(
        mirrors=(*layout.mirrors[:index], mirror.replaced(outline_in_rig_mm=outline), *layout.mirrors[index + 1 :])
    )


def test_an_outline_over_another_mirror_is_not_believed() -> None:
    seen = seen_in(frames(6, widened(MEANT, 0, right_px=30.0)))
    # Mirror 1 is described where mirror 0 is seen, and too far off to be found in its own place.
    wrong = widened(MEANT, 1, left_px=88.0)
    found, notes = _outlined(wrong, seen)
    assert found == wrong
    assert [note[: note.index(",")] for note in notes] == [
        "mirror 0-0: 1 of 4 edges are seen up to 31 px beside their places"
    ]
    assert "not moved: " in notes[0]
    assert "outlines of mirrors 0-0 and 0-1 overlap" in notes[0]


def test_a_mirror_waits_until_another_has_made_room() -> None:
    meant = widened(MEANT, 1, left_px=88.0)
    built = widened(widened(MEANT, 0, right_px=30.0), 1, left_px=58.0)
    with pytest.raises(ValidationError, match="overlap"):
        widened(meant, 0, right_px=30.0)
    found, notes = _outlined(meant, seen_in(frames(6, built)))
    assert len(notes) == 2
    assert all("moved there" in note for note in notes)
    for index in (0, 1):
        assert np.abs(found.outline_px(index, 1) - built.outline_px(index, 1)).max() < 1.0


def test_a_bent_mirror_is_the_same_surface_about_its_new_middle() -> None:
    bent = MEANT.mirrors[0].replaced(curvature_per_m=[0.08, -0.05, 0.03])
    corners = bent.outline_in_plane_mm
    # Two neighbouring edges 2 mm further in.
    lines = {}
    for edge in (0, 1):
        along = corners[(edge + 1) % 4] - corners[edge]
        normal = np.array([along[1], -along[0]]) / np.linalg.norm(along)
        level = float(normal @ corners[edge])
        lines[edge] = np.array([*normal, level - 2.0 * np.sign(level)])
    cut = _with_edges(bent, lines)
    assert np.linalg.norm(cut.outline_in_rig_mm.mean(axis=0) - bent.outline_in_rig_mm.mean(axis=0)) > 0.8
    turned = np.degrees(np.arccos(min(1.0, float(cut.normal_in_rig @ bent.normal_in_rig))))
    assert 0.001 < turned < 0.02
    points = np.array([[x, y, z] for x in (-80.0, 0.0, 90.0) for y in (200.0, 400.0) for z in (-60.0, 40.0)])

    def seen(mirror: Mirror) -> FloatArray:
        return CAMERA.project(mirror.image_of(points))

    assert seen(cut) == pytest.approx(seen(bent), abs=0.005)
    # With the outline alone, the plane would touch the surface elsewhere.
    naive = bent.replaced(outline_in_rig_mm=bent.cut(cut.outline_normalized))
    assert np.abs(seen(naive) - seen(bent)).max() > 0.05


def as_second_surface(layout: Layout) -> Layout:
    """The layout with second-surface mirrors of 2 mm acrylic, and a camera without distortion."""
    return layout.replaced(
        camera=PINHOLE,
        mirrors=tuple(
            Mirror.second_surface(
                mirror.virtual_centre_in_rig_mm, mirror.outline_in_rig_mm, thickness_mm=2.0, refractive_index=1.49
            )
            for mirror in layout.mirrors
        ),
    )


def test_the_coating_of_second_surface_mirrors_is_moved_as_far_as_its_image() -> None:
    meant, built = as_second_surface(MEANT), as_second_surface(BUILT)
    assert _outlined(meant, seen_in(frames(6, meant))) == (meant, ())
    found, _ = _outlined(meant, seen_in(frames(8, built)))
    for index in range(3):
        true = built.outline_px(index, 1)
        on_sensor = ((true > 40) & (true < [1880, 1040])).all(axis=1)
        before, after = (
            np.linalg.norm(layout.outline_px(index, 1) - true, axis=1)[on_sensor].max() for layout in (meant, found)
        )
        assert before > 8.0
        assert after < 2.0
