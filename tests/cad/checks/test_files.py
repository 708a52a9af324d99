"""Each check passes on a sound part, and was seen to fail on one broken on purpose."""

from __future__ import annotations

import shutil
from pathlib import Path

import manifold3d
import numpy as np
import pytest
import trimesh
from build123d import Align, Box, Part, Plane, import_step
from ezdxf.document import Drawing
from ezdxf.entities.lwpolyline import LWPolyline
from scipy.spatial.transform import Rotation
from shapely import Polygon

from cad.checks import check_files, check_stl
from cad.checks.cuts import check_dxf, shape_error_mm
from cad.checks.light import light_rays, shade_of_sheets
from cad.checks.seats import check_step
from cad.checks.walls import thinnest_wall_mm
from cad.cutting import draw_mirrors, place_mirrors
from cad.exports import write_step, write_stl
from cad.hardware import HARDWARE
from cad.holder.plan import plan_holder
from cad.holder.solid import make_holder
from optics.layout import Layout
from optics.values import FloatArray, Metric

Built = tuple[Layout, Path, dict[str, Metric]]
LIMITED = {
    "solids",
    "invalid_solids",
    "seats_missing",
    "seat_offset_um",
    "seat_angle_deg",
    "seat_cover",
    "mesh_watertight",
    "mesh_manifold",
    "mesh_pieces",
    "rays_blocked",
    "wall_mm",
    "outlines_missing",
    "outlines_open",
    "outline_error_um",
    "outline_gap_mm",
    "marks_off_mirror",
}


def failed(checks: dict[str, Metric]) -> set[str]:
    return {name for name, check in checks.items() if not check.passed}


def sound_part(folder: Path) -> Part:
    part = Part(import_step(folder / "mirror_holder.step").solids())
    part.label = "mirror_holder"
    return part


def cuts_of(drawing: Drawing) -> list[LWPolyline]:
    return [line for line in drawing.modelspace() if isinstance(line, LWPolyline) and line.dxf.layer == "CUT"]


def step_of(part: Part, tmp_path: Path) -> Path:
    path = tmp_path / "mirror_holder.step"
    write_step(path, part)
    return path


def stl_of(part: Part, tmp_path: Path) -> Path:
    path = tmp_path / "mirror_holder.stl"
    write_stl(path, part)
    return path


def block(centre: FloatArray, size: float) -> Box:
    return Plane(tuple(centre)) * Box(size, size, size)


@pytest.mark.parametrize("fixture", ["built_default", "built_pair", "built_second_surface"])
def test_a_sound_part_passes_every_check(fixture: str, request: pytest.FixtureRequest) -> None:
    layout, folder, _ = request.getfixturevalue(fixture)
    checks = check_files(folder, layout, HARDWARE)
    assert {name for name, check in checks.items() if check.limit is not None} == LIMITED
    assert failed(checks) == set()
    assert checks["seat_offset_um"].value < 0.01
    assert checks["seat_cover"].value > 1.0 - 1e-6
    assert checks["rays_cast"].value > 300 * len(layout.mirrors)


def test_a_seat_two_microns_too_deep_is_found(built_pair: Built, tmp_path: Path) -> None:
    layout, folder, _ = built_pair
    mirror = layout.mirrors[0]
    deeper = mirror.moved(np.eye(3), -0.002 * mirror.normal_in_rig)
    expected = layout.replaced(mirrors=(deeper, layout.mirrors[1]))
    checks = check_step(folder / "mirror_holder.step", expected)
    assert failed(checks) == {"seat_offset_um"}
    assert checks["seat_offset_um"].value == pytest.approx(2.0, abs=1e-3)


def test_a_seat_tilted_by_two_thousandths_of_a_degree_is_found(built_pair: Built) -> None:
    layout, folder, _ = built_pair
    mirror = layout.mirrors[1]
    axis = mirror.rig_from_plane[:3, 0] * np.radians(0.002)
    tilted = mirror.moved(Rotation.from_rotvec(axis).as_matrix(), np.zeros(3))
    checks = check_step(folder / "mirror_holder.step", layout.replaced(mirrors=(layout.mirrors[0], tilted)))
    assert checks["seat_angle_deg"].value == pytest.approx(0.002, rel=1e-4)
    assert "seat_angle_deg" in failed(checks)


def test_a_part_built_for_a_shifted_layout_is_found(built_pair: Built, tmp_path: Path) -> None:
    layout, _, _ = built_pair
    shifted = tuple(mirror.moved(np.eye(3), 0.01 * mirror.normal_in_rig) for mirror in layout.mirrors)
    part = make_holder(plan_holder(layout.replaced(mirrors=shifted), HARDWARE))
    checks = check_step(step_of(part, tmp_path), layout)
    assert checks["seat_offset_um"].value == pytest.approx(10.0, abs=1e-3)
    assert failed(checks) == {"seat_offset_um"}


def test_a_part_without_seats_is_found(built_pair: Built, tmp_path: Path) -> None:
    layout, _, _ = built_pair
    checks = check_step(step_of(Part(Box(10.0, 10.0, 10.0).solids()), tmp_path), layout)
    assert checks["seats_missing"].value == 2.0
    assert failed(checks) == {"seats_missing", "seat_cover"}


def test_a_notch_in_a_seat_and_a_second_solid_are_found(built_pair: Built, tmp_path: Path) -> None:
    layout, folder, _ = built_pair
    corner = layout.mirrors[0].outline_in_rig_mm[0]
    notched = sound_part(folder) - block(corner, 15.0)
    beside = block(np.array([0.0, -300.0, 0.0]), 5.0)
    checks = check_step(step_of(Part([*notched.solids(), *beside.solids()]), tmp_path), layout)
    assert failed(checks) == {"solids", "seat_cover"}
    assert checks["solids"].value == 2.0
    assert 0.8 < checks["seat_cover"].value < 0.99


def test_a_hole_in_the_mesh_is_found_and_proves_no_ray_free(built_pair: Built, tmp_path: Path) -> None:
    layout, folder, _ = built_pair
    mesh = trimesh.load_mesh(folder / "mirror_holder.stl")
    mesh.update_faces(np.arange(len(mesh.faces)) != 17)
    mesh.export(tmp_path / "mirror_holder.stl")
    checks = check_stl(tmp_path / "mirror_holder.stl", layout, HARDWARE)
    assert failed(checks) == {"mesh_watertight", "mesh_manifold", "rays_blocked", "wall_mm"}
    assert checks["rays_blocked"].value == checks["rays_cast"].value


@pytest.mark.parametrize("share", [0.6, 1.4])
def test_a_block_in_the_light_is_found(built_pair: Built, tmp_path: Path, share: float) -> None:
    """Between pupil and mirror (0.6 of the way), and between mirror and scene (1.4)."""
    layout, folder, _ = built_pair
    mirror = layout.mirrors[0]
    middle = mirror.outline_in_rig_mm.mean(axis=0)
    point = middle * min(share, 1.0) + (mirror.reflection @ middle) * max(share - 1.0, 0.0)
    part = Part([*sound_part(folder).solids(), *block(point, 3.0).solids()])
    checks = check_stl(stl_of(part, tmp_path), layout, HARDWARE)
    assert failed(checks) == {"mesh_pieces", "rays_blocked"}
    assert 0 < checks["rays_blocked"].value < 200


def test_a_thin_plate_is_found(built_pair: Built, tmp_path: Path) -> None:
    layout, folder, _ = built_pair
    body = plan_holder(layout, HARDWARE)
    x_axis, _, z_axis, origin = (tuple(column) for column in body.rig_from_mount[:3].T)
    fin = Plane(origin=origin, x_dir=x_axis, z_dir=z_axis) * Box(
        10.0, 0.9, 6.0, align=(Align.CENTER, Align.CENTER, Align.MIN)
    )
    checks = check_stl(stl_of(Part((sound_part(folder) + fin).solids()), tmp_path), layout, HARDWARE)
    assert failed(checks) == {"wall_mm"}
    assert checks["wall_mm"].value == pytest.approx(0.9, abs=1e-3)


def test_wall_of_a_plate_and_of_a_wedge() -> None:
    """A plate has its thickness; the sharp edge of a 45 deg wedge is not a wall."""

    def wall(mesh: trimesh.Trimesh) -> float:
        body = manifold3d.Manifold(manifold3d.Mesh64(np.array(mesh.vertices), np.array(mesh.faces, dtype=np.uint64)))
        return thinnest_wall_mm(mesh, body)

    assert wall(trimesh.creation.box((20.0, 30.0, 2.5))) == pytest.approx(2.5, abs=1e-6)
    corners = [(0, 0, 0), (20, 0, 0), (0, 20, 0), (0, 0, 15), (20, 0, 15), (0, 20, 15)]
    assert wall(trimesh.convex.convex_hull(np.array(corners, dtype=np.float64))) == pytest.approx(15.0, abs=1e-6)


def test_light_rays_start_on_the_mirror_and_obey_the_law_of_reflection(default_layout: Layout) -> None:
    for index, mirror in enumerate(default_layout.mirrors):
        to_pupil, to_scene = light_rays(default_layout, index, HARDWARE)
        np.testing.assert_allclose(to_pupil[:, 1], 0.0)
        np.testing.assert_allclose(to_scene[:, 1, 1], 500.0)
        # Seen from the mirror image of the pupil, the way to the scene is straight.
        seen = to_scene - mirror.virtual_centre_in_rig_mm
        straight = np.cross(seen[:, 0], seen[:, 1]) / np.linalg.norm(seen[:, 1], axis=1)[:, None]
        np.testing.assert_allclose(straight, 0.0, atol=1e-9)
        assert (np.abs(to_scene[:, 0] @ mirror.normal_in_rig + mirror.distance_mm) < 2e-3).all()


def test_sheets_shade_each_other_only_where_one_stands_before_another(default_layout: Layout) -> None:
    assert shade_of_sheets(default_layout, HARDWARE) == 0.0
    thick = tuple(mirror.replaced(surface="second", thickness_mm=3.0) for mirror in default_layout.mirrors)
    assert 0.05 < shade_of_sheets(default_layout.replaced(mirrors=thick), HARDWARE) < 0.25


def test_a_shape_is_the_same_when_moved_or_turned_but_not_when_mirrored_or_grown() -> None:
    shape = np.array([[0.0, 0.0], [10.0, 1.0], [8.0, 7.0], [-1.0, 5.0]])
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    assert shape_error_mm(np.roll(shape @ turn.T + 5.0, 1, axis=0)[::-1], shape) < 1e-12
    assert shape_error_mm(shape * [-1.0, 1.0], shape) > 0.5
    assert 1e-3 < shape_error_mm(shape * 1.001, shape) < 1e-2
    assert shape_error_mm(shape[:3], shape) == 11.0


def test_an_open_outline_is_found(built_pair: Built, tmp_path: Path) -> None:
    layout, _, _ = built_pair
    drawing = draw_mirrors(layout, HARDWARE)
    cuts_of(drawing)[0].close(False)
    drawing.saveas(tmp_path / "mirrors.dxf")
    broken = failed(check_dxf(tmp_path / "mirrors.dxf", layout))
    assert broken == {"outlines_missing", "outlines_open", "marks_off_mirror"}


def test_outlines_seen_from_the_wrong_side_too_close_or_unmarked_are_found(
    default_layout: Layout, tmp_path: Path
) -> None:
    def redrawn(scale: FloatArray, shift_mm: float) -> dict[str, Metric]:
        drawing = draw_mirrors(default_layout, HARDWARE)
        for place, line in enumerate(cuts_of(drawing)):
            corners = np.array(line.get_points("xy")) * scale + [shift_mm * (place == 0), 0.0]
            line.set_points(corners.tolist(), format="xy")
        drawing.saveas(tmp_path / "mirrors.dxf")
        return check_dxf(tmp_path / "mirrors.dxf", default_layout)

    assert failed(redrawn(np.array([1.0, 1.0]), 0.0)) == set()
    mirrored = redrawn(np.array([-1.0, 1.0]), 0.0)
    assert failed(mirrored) == {"outline_error_um", "marks_off_mirror"}
    grown = redrawn(np.array([1.0001, 1.0001]), 0.0)
    assert failed(grown) == {"outline_error_um"}
    left, right = (Polygon(cut.outline) for cut in place_mirrors(default_layout, HARDWARE)[:2])
    close = redrawn(np.array([1.0, 1.0]), left.distance(right))
    assert 0.0 <= close["outline_gap_mm"].value < left.distance(right)
    overlapping = redrawn(np.array([1.0, 1.0]), 2.0 * left.distance(right) + 5.0)
    assert "outline_gap_mm" in failed(overlapping)


def test_a_missing_mirror_is_found(built_pair: Built, tmp_path: Path) -> None:
    layout, folder, _ = built_pair
    shutil.copy(folder / "mirrors.dxf", tmp_path / "mirrors.dxf")
    three = layout.replaced(
        cols=3,
        mirrors=(
            *layout.mirrors,
            layout.mirrors[0].replaced(
                outline_in_rig_mm=layout.mirrors[0].cut(layout.mirrors[0].outline_normalized - [2.0, 0.0])
            ),
        ),
    )
    assert failed(check_dxf(tmp_path / "mirrors.dxf", three)) == {"outlines_missing"}
