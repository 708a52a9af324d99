"""The parts of a real device in a scene: their poses, what they hide and what they scatter.

What stops light around the mirrors: against closed forms, and against pictures.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import read_image
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.boards import Charuco
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.perturbations import draw_as_built, draw_perturbations
from mirrorcam.optics.geometry.tolerances import Tolerances
from mirrorcam.optics.geometry.transforms import rigid, transform
from mirrorcam.render_scenes.boards import print_on_paper
from mirrorcam.render_scenes.reference.board_scene import BoardScene
from mirrorcam.render_scenes.reference.device_bodies import (
    PLASTIC_RGB,
    BodyObstacles,
    checksum,
    holder_from_rig,
    in_camera_frame,
    parts_of,
    read_bodies,
    read_device,
)
from mirrorcam.render_scenes.sets.poses import plan_frames
from mirrorcam.render_scenes.sets.render_set import render_set
from mirrorcam.render_scenes.sets.set_request import SetRequest
from mirrorcam.render_scenes.settings import SENSORS, RenderSettings, SurfaceFinish
from mirrorcam.render_scenes.truth.corners import CornerProjector
from mirrorcam.render_scenes.truth.pixel_maps import NO_MIRROR, board_maps, pixel_rays
from mirrorcam.render_scenes.variant import SCALAR, use_variant
from mirrorcam.simulation.rendering import in_workers
from tests.render_scenes.devices import SETTINGS, box, scene_of, write_glb, write_stl


@pytest.fixture(scope="module")
def pose(small_layout: Layout, small_board: Charuco) -> FloatArray:
    return plan_frames(small_layout, small_board, 1, np.random.default_rng(1)).poses[0]


def test_how_the_camera_sits_in_its_holder_is_found_from_the_mirrors(default_layout: Layout) -> None:
    tolerances = Tolerances(camera_offset_mm=0.4, camera_turn_deg=0.5)
    perturbations = draw_perturbations(tolerances, 9, 1, np.random.default_rng(5))
    found = holder_from_rig(default_layout, draw_as_built(default_layout, tolerances, np.random.default_rng(5)))
    assert np.linalg.norm(perturbations.camera_shifts_mm[0]) > 0.1
    np.testing.assert_allclose(found[:3, 3], perturbations.camera_shifts_mm[0], atol=1e-9)
    np.testing.assert_allclose(found @ np.linalg.inv(found), np.eye(4), atol=1e-12)
    # A body stays where it is in the holder.
    body = in_camera_frame(box((0, 0, 0), (1, 2, 3)), found)
    np.testing.assert_allclose(transform(found, body.points), box((0, 0, 0), (1, 2, 3)).points, atol=1e-9)


@pytest.mark.parametrize("surface", ["first", "second"])
def test_what_stands_before_a_mirror_hides_it(
    surface: str, small_layout: Layout, small_board: Charuco, pose: FloatArray
) -> None:
    """All other pixels are unchanged; for a plate, the sum over all branches."""
    mirrors = tuple(mirror.replaced(surface=surface, thickness_mm=2.0) for mirror in small_layout.mirrors)
    small_layout = small_layout.replaced(mirrors=mirrors, kind="as-built")
    alone, crop = scene_of(small_layout, small_board, pose), (200, 90, 80, 80)
    mirror = small_layout.mirrors[4]
    half = np.array([1.0, 1.0, 0.1])
    before = 0.6 * mirror.outline_in_rig_mm.mean(axis=0)
    wall = box(before - half, before + half)
    x, y = small_layout.camera.project(before)
    free, hidden = (
        scene.render(spp=4, seed=1, crop=crop) for scene in (alone, scene_of(small_layout, small_board, pose, wall))
    )
    row, column = int(y) - crop[1], int(x) - crop[0]
    # Below it is only the sky, and the light of the board via a mirror.
    on_wall = hidden[row - 2 : row + 3, column - 2 : column + 3]
    np.testing.assert_allclose(on_wall, 0.2 * SETTINGS.surroundings, rtol=0.02)
    shown = (cv2.erode(free, np.ones((3, 3))) > 0.0) & (
        np.hypot(*np.ogrid[-row : 80 - row, -column : 80 - column]) > 20
    )
    assert shown.sum() > 1000
    np.testing.assert_allclose(hidden[shown], free[shown], atol=1e-6)


def test_a_board_lights_a_wall_as_much_as_a_formula_says(small_layout: Layout, small_board: Charuco) -> None:
    """A matte wall next to a board, without other light: radiance = reflectance / pi * integral of L cos cos / r^2."""
    dark, wall = (
        RenderSettings(surroundings=0.0, sensor=SENSORS["ideal"]),
        box((-100.0, -100.0, 200.0), (100.0, 100.0, 210.0)),
    )
    # The board stands at the left of the field and faces right.
    turn = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    pose = rigid(turn, [-150.0, -small_board.size_mm[1] / 2.0, -100.0])
    scene = BoardScene(small_layout.camera, (), small_board, dark, bodies=(wall,))
    scene.place_board(pose)
    crop = (240, 135, 8, 8)
    found = scene.render(spp=256, seed=1, crop=crop)
    (at,) = scene.camera.unproject(np.array([[243.5, 138.5]])) * 200.0
    texels = np.kron(print_on_paper(small_board), np.ones((3, 3)))
    radiance = dark.ink + (dark.paper - dark.ink) * texels / 255.0
    side = small_board.size_mm[0] / small_board.cols * (small_board.cols + 2) / texels.shape[1]
    y, x = (np.mgrid[: texels.shape[0], : texels.shape[1]] + 0.5) * side - small_board.square_mm
    points = transform(pose, np.stack([x, y, np.zeros_like(x)], axis=-1))
    way = points - at
    squared = np.square(way).sum(axis=-1)
    seen = np.maximum(way @ pose[:3, 2], 0.0) * np.maximum(-way[..., 2], 0.0) / squared**2
    expected = 0.2 / np.pi * (radiance * seen).sum() * side**2
    assert found.mean() == pytest.approx(expected, rel=0.01)
    assert expected > 0.003


def test_a_matte_wall_under_an_even_sky_is_as_bright_as_the_sky_times_its_reflectance(
    small_layout: Layout, small_board: Charuco
) -> None:
    """In whichever direction a convex body faces, and without noise."""
    scene = BoardScene(
        small_layout.camera, (), small_board, SETTINGS, bodies=(box((-100.0, -100.0, 200.0), (100.0, 100.0, 210.0)),)
    )
    scene.place_board(rigid(np.eye(3), [0.0, 0.0, 400.0]))
    found = scene.render(spp=8, seed=1, crop=(220, 120, 40, 30))
    np.testing.assert_allclose(found, 0.2 * SETTINGS.surroundings, rtol=1e-4)


def test_plates_of_a_device_are_as_thick_as_they_are(
    small_layout: Layout, small_board: Charuco, pose: FloatArray
) -> None:
    """Light that comes along the plane of a first-surface mirror, half its thickness behind it, ends at its edge."""
    mirror = small_layout.mirrors[4]
    edge = mirror.outline_in_rig_mm[:2].mean(axis=0)
    inwards = mirror.outline_in_rig_mm.mean(axis=0) - edge
    inwards /= np.linalg.norm(inwards)
    start = edge - 0.5 * mirror.thickness_mm * mirror.normal_in_rig - 2.0 * inwards
    far = box((900.0, 0.0, 0.0), (901.0, 1.0, 1.0))
    for bodies, met in (((far,), True), ((), False)):
        scene = scene_of(small_layout.replaced(rows=1, cols=1, mirrors=(mirror,)), small_board, pose, *bodies)
        import mitsuba as mi

        hit = scene.scene.ray_intersect(mi.Ray3f(mi.Point3f(*start.tolist()), mi.Vector3f(*inwards.tolist())))
        assert bool(hit.t[0] < 10.0) == met
        if met:
            assert hit.t[0] == pytest.approx(2.0, abs=1e-3)


def test_the_camera_does_not_hide_itself(small_layout: Layout, small_board: Charuco, pose: FloatArray) -> None:
    own = box((-40.0, -12.0, -30.0), (40.0, 12.0, 5.0), kind="camera")
    crop = (200, 90, 80, 40)
    seen = scene_of(small_layout, small_board, pose, own).render(spp=4, seed=1, crop=crop)
    free = scene_of(small_layout, small_board, pose).render(spp=4, seed=1, crop=crop)
    np.testing.assert_allclose(seen[free > 0.0], free[free > 0.0], atol=1e-5)
    hidden = scene_of(small_layout, small_board, pose, box((-40.0, -12.0, -30.0), (40.0, 12.0, 5.0)))
    assert np.abs(hidden.render(spp=4, seed=1, crop=crop) - free).mean() > 0.1


def test_the_scalar_variant_shows_parts_alike(small_layout: Layout, small_board: Charuco, pose: FloatArray) -> None:
    """Equal except for noise."""
    wall, crop = box((-60.0, -60.0, 150.0), (60.0, 60.0, 160.0)), (220, 130, 12, 8)
    pictures = [
        scene_of(small_layout, small_board, pose, wall, variant=variant).render(spp=8, seed=1, crop=crop)
        for variant in (None, SCALAR)
    ]
    np.testing.assert_allclose(pictures[0].mean(), pictures[1].mean(), rtol=1e-3)


def test_the_files_of_a_device_are_read(tmp_path: Path, default_layout: Layout) -> None:
    with pytest.raises(InputError, match=r"no assembly\.glb and no \.stl files"):
        read_bodies(tmp_path)
    wall = box((0.0, 0.0, 0.0), (1.0, 2.0, 3.0))
    write_stl(tmp_path / "wall.stl", wall)
    write_stl(tmp_path / "fit_coupon.stl", wall)  # to print, but no piece of the device
    (found,) = read_bodies(tmp_path)
    assert found.name == "wall"
    np.testing.assert_allclose(np.sort(found.points, axis=0), np.sort(wall.points, axis=0))
    assert len(found.faces) == 12
    # A set begun with these parts is not continued with others.
    parts = parts_of(tmp_path, default_layout, default_layout)
    assert len(read_device(parts)) == 1
    write_stl(tmp_path / "another.stl", wall)
    with pytest.raises(InputError, match="parts have changed since the set was started"):
        read_device(parts)
    write_glb(tmp_path / "assembly.glb", {"holder": ("part", wall), "mirror_0-0": ("mirror", wall)}, np.eye(3))
    with pytest.raises(InputError, match="parts of a different layout"):
        parts_of(tmp_path, default_layout, default_layout)
    (holder,) = read_bodies(tmp_path)
    assert (holder.name, holder.kind, holder.rgb) == ("holder", "part", (0.25, 0.5, 0.75))
    np.testing.assert_array_equal(holder.points[holder.faces], wall.points[wall.faces])
    raw = (tmp_path / "assembly.glb").read_bytes()
    for broken in (raw[:40], b"glXF" + raw[4:], raw.replace(b'"device"', b'"degree"'), raw[:-100]):
        (tmp_path / "assembly.glb").write_bytes(broken)
        with pytest.raises(InputError, match=r"assembly\.glb: not an assembly of `mirrorcam cad`") as error:
            read_bodies(tmp_path)
        assert "\n" not in str(error.value)


def test_a_set_of_a_device_is_rendered_with_its_parts(
    tmp_path: Path, small_layout: Layout, small_board: Charuco
) -> None:
    half = np.array([2.0, 2.0, 0.1])
    middle = 0.6 * small_layout.mirrors[4].outline_in_rig_mm.mean(axis=0)
    (tmp_path / "parts").mkdir()
    write_stl(tmp_path / "parts" / "wall.stl", box(middle - half, middle + half))
    request = SetRequest(
        layout=small_layout,
        board=small_board,
        frames=1,
        base_frames=1,
        tolerances=Tolerances.none(),
        settings=RenderSettings(spp=4, maps=False, sensor=SENSORS["ideal"]),
    )
    free = render_set(request, tmp_path / "free")
    dataset = render_set(request.replaced(parts=tmp_path / "parts"), tmp_path / "set")
    assert dataset.parts == checksum(tmp_path / "parts")
    assert free.parts is None
    x, y = small_layout.camera.project(middle).round().astype(int)
    # Dark plastic under the sky; without it, paper or ink.
    hidden, seen = (read_image(tmp_path / name / "frames" / "0000.png", grey=True)[y, x] for name in ("set", "free"))
    assert hidden == pytest.approx(255.0 * PLASTIC_RGB[0] * request.settings.surroundings, abs=1.0)
    assert seen > 8
    # The bare camera has no parts around it.
    for name in dataset.base_names:
        assert (tmp_path / "set" / name).read_bytes() == (tmp_path / "free" / name).read_bytes()
    fast = request.replaced(parts=tmp_path / "parts", settings=RenderSettings(renderer="fast"))
    with pytest.raises(InputError, match="renderer fast"):
        render_set(fast, tmp_path / "fast")
    assert not (tmp_path / "fast").exists()


@pytest.mark.slow
def test_workers_render_a_device_to_the_same_bytes(tmp_path: Path, small_layout: Layout, small_board: Charuco) -> None:
    """Its parts, its rough and bent mirrors, and all random draws."""
    (tmp_path / "parts").mkdir()
    write_stl(tmp_path / "parts" / "wall.stl", box((-70.0, -80.0, -20.0), (70.0, -75.0, 150.0)))
    request = SetRequest(
        layout=small_layout,
        board=small_board,
        frames=2,
        base_frames=0,
        settings=RenderSettings(
            spp=4, maps=False, finish=SurfaceFinish(roughness=1e-3, sag_mm=0.02, reflectance_percent=2.0)
        ),
        parts=tmp_path / "parts",
    )
    sets = [tmp_path / "workers", tmp_path / "here"]
    render_set(request, sets[0], run=in_workers(2))
    render_set(request, sets[1])
    names = sorted(path.relative_to(sets[0]) for path in sets[0].rglob("*") if path.is_file())
    assert len(names) == 10
    for name in names:
        assert (sets[0] / name).read_bytes() == (sets[1] / name).read_bytes(), name


@pytest.mark.parametrize("variant", [None, SCALAR])
def test_rays_go_as_far_as_the_faces_of_a_box(variant: str | None) -> None:
    use_variant(variant)
    obstacles = BodyObstacles([box((-10.0, -20.0, 100.0), (10.0, 20.0, 130.0))])
    sideways = np.array([0.6, 0.0, 0.8])
    starts = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 200.0], [30.0, 0.0, 0.0], [-69.0, 0.0, 0.0], [np.nan, 0.0, 0.0]])
    ways = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [0.0, 0.0, 1.0], sideways, [0.0, 0.0, 1.0]])
    # The fourth passes z = 100 at x = 6, the others run along z.
    expected = [100.0, 70.0, np.inf, 125.0, np.nan]
    np.testing.assert_allclose(obstacles.distance_to_body_mm(starts, ways), expected, rtol=1e-6)
    assert obstacles.distance_to_body_mm(starts[:4].reshape(2, 2, 3), ways[:4].reshape(2, 2, 3)).shape == (2, 2)


def test_light_to_the_pupil_is_not_stopped_by_the_body_of_the_camera() -> None:
    use_variant()
    camera, wall = (
        box((-40.0, -12.0, -30.0), (40.0, 12.0, 5.0), kind="camera"),
        box((-9.0, -9.0, 80.0), (9.0, 9.0, 81.0)),
    )
    obstacles = BodyObstacles([camera, wall])
    rays = np.array([[0.0, 0.0, 1.0], [0.0, 0.6, 0.8]])
    np.testing.assert_allclose(obstacles.distance_from_pupil_mm(rays), [80.0, np.inf], rtol=1e-6)


def test_the_truth_knows_what_parts_hide(small_layout: Layout, small_board: Charuco, pose: FloatArray) -> None:
    """A wall between camera and mirror, then one between mirror and board: maps and corners against the picture."""
    middle = small_layout.mirrors[4].outline_in_rig_mm.mean(axis=0)
    seen = board_maps(pixel_rays(small_layout, mirrors=True), small_board, pose)
    px, before = CornerProjector(small_layout, small_board).via_mirrors(pose)
    free = scene_of(small_layout, small_board, pose).render(spp=16, seed=1)
    walls = (0.6 * middle, [3.0, 3.0, 0.1]), (middle + 120.0 * small_layout.view_from_rig[2], [4.0, 0.1, 4.0])
    for kept, (at, half) in enumerate(walls):
        wall = box(at - half, at + half)
        obstacles = BodyObstacles([wall])
        maps = board_maps(pixel_rays(small_layout, mirrors=True, obstacles=obstacles), small_board, pose)
        hidden = np.isfinite(seen["board.x"]) & ~np.isfinite(maps["board.x"])
        assert 20 < hidden.sum() < 3000
        lost_mirrors = (maps["mirror"][hidden] == NO_MIRROR).mean()
        assert lost_mirrors == (0.0 if kept else 1.0)
        picture = scene_of(small_layout, small_board, pose, wall).render(spp=16, seed=1)
        shown = np.isfinite(maps["board.x"])
        inside, outside = (cv2.erode(part.astype(np.uint8), np.ones((3, 3))) > 0 for part in (hidden, shown))
        assert inside.sum() > 10
        plastic = 0.2 * SETTINGS.surroundings * (SETTINGS.mirror_reflectance if kept else 1.0)
        assert (np.abs(picture[inside] - plastic) < 0.3 * plastic).mean() > 0.95
        assert (np.abs(picture - free)[outside] < 1e-5).mean() > 0.999
        after = CornerProjector(small_layout, small_board, (), obstacles).via_mirrors(pose)[1]
        assert not (after & ~before).any()
        near = cv2.dilate(hidden.astype(np.uint8), np.ones((7, 7))) > 0
        lost = px[before & ~after].round().astype(int)
        assert len(lost) > 0
        assert near[lost[:, 1], lost[:, 0]].all()
        still = px[after].round().astype(int)
        assert not hidden[still[:, 1], still[:, 0]].any()
