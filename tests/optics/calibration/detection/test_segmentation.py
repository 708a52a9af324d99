"""Outlines of mirrors found in pictures, against the true ones."""

from __future__ import annotations

import numpy as np
import pytest
from shapely import Polygon

from mirrorcam.core.values import FloatArray, InvalidValue
from mirrorcam.optics.calibration.detection.segmentation import Extremes, Side, visible_part_in_plane_mm, with_edges
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from tests.optics.calibration.detection.mirror_frames import (
    BUILT,
    CAMERA,
    MEANT,
    PINHOLE,
    frames,
    outlined_in,
    seen_in,
    worst_px,
)

SQUARE = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [0.0, 3.0]])


def test_mirrors_cut_and_glued_with_errors_get_their_true_outlines() -> None:
    found, notes = outlined_in(MEANT, seen_in(frames(12)))
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
    # As designed, and seen there: it is not moved within the width of a blurred edge.
    assert found.mirrors[3] == MEANT.mirrors[3]


def test_the_end_of_a_board_is_not_taken_for_the_mirrors() -> None:
    frames_of_boards = frames(8, MEANT, inner=BUILT)
    assert outlined_in(MEANT, seen_in(frames_of_boards)) == (MEANT, ())
    assert outlined_in(MEANT, seen_in(frames_of_boards[1::2]))[1], "the boards' own ends would be believed"


def test_without_an_edge_nothing_moves() -> None:
    assert outlined_in(MEANT, Extremes()) == (MEANT, ())
    assert outlined_in(MEANT, seen_in([np.full((1080, 1920), 90, np.uint8)] * 5)) == (MEANT, ())
    assert outlined_in(MEANT, seen_in(frames(3))) == (MEANT, ())


def inflation(layout: Layout, index: int, *, left_px: float = 0.0, right_px: float = 0.0) -> Layout:
    """The layout with one mirror wider on the sensor."""
    mirror, corners = layout.mirrors[index], layout.outline_px(index, 1)
    corners[:, 0] += np.where(corners[:, 0] < corners[:, 0].mean(), -left_px, right_px)
    outline = mirror.intersect(layout.camera.normalized_from_pixels(corners))
    return layout.replaced(
        mirrors=(*layout.mirrors[:index], mirror.replaced(outline_in_rig_mm=outline), *layout.mirrors[index + 1 :])
    )


def test_an_outline_over_another_mirror_is_rejected() -> None:
    seen = seen_in(frames(6, inflation(MEANT, 0, right_px=30.0)))
    # Mirror 1 is described at the place of mirror 0, too far from its own place to be found.
    wrong = inflation(MEANT, 1, left_px=88.0)
    found, notes = outlined_in(wrong, seen)
    assert found == wrong
    assert [note[: note.index(",")] for note in notes] == ["mirror 0-0: 1 of 4 edges are displaced by up to 31 px"]
    assert "not moved: " in notes[0]
    assert "outlines of mirrors 0-0 and 0-1 overlap" in notes[0]


def test_a_mirror_moves_after_another_has_made_room() -> None:
    meant = inflation(MEANT, 1, left_px=88.0)
    built = inflation(inflation(MEANT, 0, right_px=30.0), 1, left_px=58.0)
    with pytest.raises(InvalidValue, match="overlap"):
        inflation(meant, 0, right_px=30.0)
    found, notes = outlined_in(meant, seen_in(frames(6, built)))
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
    cut = with_edges(bent, lines)
    assert np.linalg.norm(cut.outline_in_rig_mm.mean(axis=0) - bent.outline_in_rig_mm.mean(axis=0)) > 0.8
    turned = np.degrees(np.arccos(min(1.0, float(cut.normal_in_rig @ bent.normal_in_rig))))
    assert 0.001 < turned < 0.02
    points = np.array([[x, y, z] for x in (-80.0, 0.0, 90.0) for y in (200.0, 400.0) for z in (-60.0, 40.0)])

    def seen(mirror: Mirror) -> FloatArray:
        return CAMERA.project(mirror.image_of(points))

    assert seen(cut) == pytest.approx(seen(bent), abs=0.005)
    # From the outline alone, the plane would touch the surface at another point.
    naive = bent.replaced(outline_in_rig_mm=bent.intersect(cut.outline_normalized))
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


@pytest.mark.slow
def test_the_coating_of_second_surface_mirrors_moves_with_its_image() -> None:
    meant, built = as_second_surface(MEANT), as_second_surface(BUILT)
    assert outlined_in(meant, seen_in(frames(6, meant))) == (meant, ())
    found, _ = outlined_in(meant, seen_in(frames(8, built)))
    for index in range(3):
        true = built.outline_px(index, 1)
        on_sensor = ((true > 40) & (true < [1880, 1040])).all(axis=1)
        before, after = (
            np.linalg.norm(layout.outline_px(index, 1) - true, axis=1)[on_sensor].max() for layout in (meant, found)
        )
        assert before > 8.0
        assert after < 2.0


@pytest.mark.parametrize("polygon", [SQUARE, SQUARE[::-1]])
def test_a_side_runs_along_its_edge_and_points_outwards(polygon: FloatArray) -> None:
    for edge in range(4):
        side = Side.of(polygon, edge)
        np.testing.assert_allclose(side.start + side.length_mm * side.direction, polygon[(edge + 1) % 4])
        assert abs(side.direction @ side.outward) < 1e-12
        assert side.outward @ (side.start - polygon.mean(axis=0)) > 0.0


def test_a_side_moves_by_the_offsets_at_the_ends_of_another() -> None:
    side = Side.of(SQUARE, 0)
    nx, ny, d = side.displaced_line(side, np.array([0.5, 0.5]))
    assert abs(ny) == pytest.approx(1.0)
    assert nx == pytest.approx(0.0)
    assert d / ny == pytest.approx(-0.5)
    nx, ny, d = side.displaced_line(side, np.array([0.0, 0.4]))
    assert nx * 0.0 == pytest.approx(d)
    assert (d - nx * 4.0) / ny == pytest.approx(-0.4)


def test_a_first_surface_mirror_shows_the_scene_up_to_its_edge_and_a_plate_does_not() -> None:
    mirror = MEANT.mirrors[0]
    np.testing.assert_array_equal(visible_part_in_plane_mm(mirror), mirror.apparent.outline_in_plane_mm)
    plate = mirror.replaced(surface="second", thickness_mm=2.0)
    shown, complete = Polygon(visible_part_in_plane_mm(plate)), Polygon(plate.apparent.outline_in_plane_mm)
    assert 0.8 * complete.area < shown.area < 0.99 * complete.area
