"""Light in a closed room against closed forms: sky, lamp, glass, mirrors, and their noise.

Intersections with the objects and rays of pinholes, against closed forms.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from mirrorcam.core.errors import InputError
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import rigid
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.render_scenes.tabletop.objects import SceneObject
from mirrorcam.render_scenes.tabletop.tabletop import Tabletop, arrange_tabletop
from mirrorcam.render_scenes.tabletop.tabletop_scene import NOTHING, RayThrough, TabletopScene, pinhole_rays, render_lit
from mirrorcam.render_scenes.variant import SCALAR, use_variant

SIZE = 24, 16
SKY = [0.3, 0.5, 0.8]
PAINT = [0.6, 0.2, 0.4]


@pytest.fixture(scope="module", autouse=True)
def in_colour() -> None:
    if use_variant(colour=True) == SCALAR:
        pytest.skip("nothing compiles in colour")


def rgb(values: list[float]) -> dict[str, Any]:
    return {"type": "rgb", "value": values}


def matte(colour: list[float]) -> dict[str, Any]:
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": rgb(colour)}}


def straight_on(height: float = 10.0, spread: float = 0.05) -> RayThrough:
    """Rays of SIZE pixels from (0, 0, height) down, `spread` apart on the plane one below."""
    import mitsuba as mi

    def ray_through(x: Any, y: Any, u: Any, v: Any) -> Any:
        import drjit as dr

        way = mi.Vector3f((x - SIZE[0] / 2) * spread, (y - SIZE[1] / 2) * spread, -1.0)
        return mi.Ray3f(mi.Point3f(0.0, 0.0, height), dr.normalize(way))

    return ray_through


def rendered(scene: dict[str, Any], **how: Any) -> NDArray[np.float32]:
    import mitsuba as mi

    usual: dict[str, Any] = {"size": SIZE, "subpixels": 1, "spp": 64, "seed": 3, "via_mirrors": False}
    return render_lit(mi.load_dict({"type": "scene", **scene}), straight_on(), is_pinhole=True, **(usual | how))


def sky() -> dict[str, Any]:
    return {"sky": {"type": "constant", "radiance": rgb(SKY)}}


def test_an_open_sky_lights_what_is_matte_without_noise() -> None:
    ball = {"type": "sphere", "radius": 9.0, "bsdf": matte(PAINT)}
    light = rendered(sky() | {"ball": ball}, spp=4)
    assert np.abs(light[4:12, 6:18] - np.multiply(SKY, PAINT)).max() < 1e-5


def test_a_corner_is_lit_by_what_it_scatters() -> None:
    """On the floor of a long trench that opens by the sine of 30 degrees to each side: half the sky, and the walls."""
    height = 2.0 / np.tan(np.pi / 6)

    def wall(side: float) -> dict[str, Any]:
        import mitsuba as mi

        to_world = mi.ScalarTransform4f().translate([side * 2.0, 0.0, height / 2.0])
        to_world = to_world @ mi.ScalarTransform4f().rotate([0, 1, 0], 90.0)
        to_world = to_world @ mi.ScalarTransform4f().scale([height / 2.0, 4000.0, 1.0])
        return {"type": "rectangle", "to_world": to_world, "bsdf": matte([0.0, 0.0, 0.0])}

    floor = {"type": "rectangle", "bsdf": matte(PAINT)}
    light = rendered(sky() | {"floor": floor, "left": wall(-1.0), "right": wall(1.0)}, spp=256)
    middle = light[7:9, 11:13].mean(axis=(0, 1))
    assert middle == pytest.approx(np.multiply(SKY, PAINT) * np.sin(np.pi / 6), rel=0.02)


def lamp(height: float, radius: float, radiance: float) -> dict[str, Any]:
    import mitsuba as mi

    to_world = mi.ScalarTransform4f().translate([0.0, 0.0, height]) @ mi.ScalarTransform4f().rotate([1, 0, 0], 180.0)
    to_world = to_world @ mi.ScalarTransform4f().scale([radius, radius, 1.0])
    return {"type": "disk", "to_world": to_world, "emitter": {"type": "area", "radiance": rgb([radiance] * 3)}}


def test_a_lamp_lights_by_its_size_and_distance() -> None:
    floor = {"type": "rectangle", "to_world": scaled(50.0), "bsdf": matte(PAINT)}
    light = rendered({"lamp": lamp(12.0, 3.0, 5.0), "floor": floor}, spp=256)
    expected = 5.0 * np.array(PAINT) * 3.0**2 / (12.0**2 + 3.0**2)  # a disk over what is parallel to it
    assert light[7:9, 11:13].mean(axis=(0, 1)) == pytest.approx(expected, rel=0.005)


def scaled(factor: float) -> Any:
    import mitsuba as mi

    return mi.ScalarTransform4f().scale([factor, factor, 1.0])


def test_what_stands_before_a_lamp_throws_a_shadow() -> None:
    import mitsuba as mi

    floor = {"type": "rectangle", "to_world": scaled(50.0), "bsdf": matte(PAINT)}
    lid_to_world = mi.ScalarTransform4f().translate([0.0, 0.0, 11.5]) @ mi.ScalarTransform4f().scale([6.0, 6.0, 1.0])
    lid = {"type": "rectangle", "to_world": lid_to_world, "bsdf": matte([0.0] * 3)}
    assert rendered({"lamp": lamp(12.0, 3.0, 5.0), "floor": floor, "lid": lid}).max() == 0.0


def test_a_bound_leaves_out_what_comes_by_way_of_another_surface_only() -> None:
    floor = {"type": "rectangle", "to_world": scaled(50.0), "bsdf": matte(PAINT)}
    ball = {"type": "sphere", "center": [0.0, 0.0, 2.0], "radius": 2.0, "bsdf": matte(PAINT)}
    alone = {"lamp": lamp(12.0, 3.0, 5.0), "floor": floor}
    assert np.array_equal(rendered(alone), rendered(alone, max_indirect=0.0))
    both = alone | {"ball": ball}
    free, high, none = (rendered(both, max_indirect=bound) for bound in (np.inf, 1e6, 0.0))
    assert np.array_equal(free, high)
    assert (none <= free).all()
    assert none.mean() < 0.995 * free.mean()


def test_glass_under_an_even_sky_cannot_be_seen() -> None:
    ball = {"type": "sphere", "radius": 5.0, "bsdf": {"type": "dielectric", "int_ior": 1.5, "ext_ior": 1.0}}
    light = rendered(sky() | {"ball": ball}, spp=16)
    assert np.abs(light - SKY).max() < 1e-4


def test_a_plate_of_glass_lets_through_what_its_two_faces_leave() -> None:
    plate = {"type": "cube", "to_world": scaled(50.0), "bsdf": {"type": "dielectric", "int_ior": 2.4, "ext_ior": 1.0}}
    import mitsuba as mi

    below = mi.ScalarTransform4f().translate([0.0, 0.0, -2.0]) @ scaled(500.0)
    light = {"type": "rectangle", "to_world": below, "emitter": {"type": "area", "radiance": rgb([1.0] * 3)}}
    found = rendered({"plate": plate, "light": light}, spp=256).mean()
    lost = (1.4 / 3.4) ** 2  # by a face, square on; light goes to and fro between the two
    assert found == pytest.approx((1.0 - lost) / (1.0 + lost), rel=0.01)


def test_a_mirror_shows_the_lamp_and_takes_its_part() -> None:
    import mitsuba as mi

    silver = {"type": "conductor", "material": "none", "specular_reflectance": rgb([0.9, 0.8, 0.7])}
    up = mi.ScalarTransform4f().translate([0.0, 0.0, 12.0]) @ mi.ScalarTransform4f().rotate([1, 0, 0], 180.0)
    above = {
        "type": "rectangle",
        "to_world": up @ scaled(99.0),
        "emitter": {"type": "area", "radiance": rgb([2.0] * 3)},
    }
    mirror = {"type": "rectangle", "to_world": scaled(50.0), "bsdf": silver}
    light = rendered({"mirror": mirror, "above": above}, via_mirrors=True, spp=4)
    assert np.abs(light - np.multiply(2.0, [0.9, 0.8, 0.7])).max() < 1e-5


def test_by_mirrors_nothing_else_is_seen() -> None:
    floor = {"type": "rectangle", "to_world": scaled(50.0), "bsdf": matte(PAINT)}
    assert rendered(sky() | {"floor": floor}, spp=4).min() > 0.05
    assert rendered(sky() | {"floor": floor}, spp=4, via_mirrors=True).max() == 0.0
    assert rendered(sky(), spp=4, via_mirrors=True).max() == 0.0


def test_noise_falls_faster_than_by_chance_and_the_same_seed_gives_the_same() -> None:
    floor = {"type": "rectangle", "to_world": scaled(50.0), "bsdf": matte(PAINT)}
    ball = {"type": "sphere", "center": [0.0, 0.0, 2.0], "radius": 2.0, "bsdf": matte(PAINT)}
    scene = sky() | {"lamp": lamp(14.0, 3.0, 5.0), "floor": floor, "ball": ball}
    spread = {}
    for spp in (16, 256):
        one, two = (rendered(scene, spp=spp, seed=seed) for seed in (1, 2))
        spread[spp] = float(np.sqrt(np.mean(np.square(one - two)) / 2.0) / one.mean())
    # Sixteen times the samples: independent random ones would leave a quarter.
    assert spread[256] < 0.25 * spread[16]
    assert spread[256] < 0.01
    assert np.array_equal(rendered(scene, spp=16), rendered(scene, spp=16))


def test_rays_meet_the_nearest_object_where_a_formula_says(small_layout: Layout) -> None:
    wall = SceneObject(
        name="wall",
        kind="rectangle",
        material="matte",
        view_from_object=rigid(np.eye(3), [0.0, 0.0, 500.0]),
        size_mm=np.array([200.0, 200.0, 0.0]),
    )
    ball = SceneObject(
        name="ball",
        kind="sphere",
        material="matte",
        view_from_object=rigid(np.eye(3), [30.0, 0.0, 400.0]),
        size_mm=np.array([40.0, 0.0, 0.0]),
    )
    tabletop = Tabletop((wall, ball), np.array([0.0, 0.0, 400.0]), 200.0)
    scene = TabletopScene(small_layout, tabletop, mirror_reflectance=0.9)
    forward = small_layout.view_from_rig[2]
    starts = np.array([[0.0, 0.0, 300.0], [30.0, 0.0, 300.0], [150.0, 0.0, 300.0], [np.nan] * 3])
    hits = scene.hits(starts @ small_layout.view_from_rig, np.tile(forward, (4, 1)))
    assert hits.object_index.tolist() == [0, 1, NOTHING, NOTHING]
    np.testing.assert_allclose(hits.path_mm, [200.0, 80.0, np.inf, np.inf], atol=1e-3)
    np.testing.assert_allclose(
        hits.points[:2] @ small_layout.view_from_rig.T, [[0.0, 0.0, 500.0], [30.0, 0.0, 380.0]], atol=1e-3
    )


def test_rays_of_a_view_start_at_a_depth_and_meet_on_the_reference_plane(small_layout: Layout) -> None:
    views = Decoder(small_layout).views
    forward = views.view_from_rig[2]
    corners = []
    for t, s in ((0, 0), (1, 1), (2, 2)):
        start, direction = pinhole_rays(views, t, s, 200.0)
        np.testing.assert_allclose(start @ forward, 200.0, atol=1e-9)
        np.testing.assert_allclose(np.linalg.norm(direction, axis=-1), 1.0)
        plane = views.plane_points_in_rig(views.reference_depth_mm, views.pixel_grid())
        along = ((plane - start) * direction).sum(axis=-1)
        np.testing.assert_allclose(start + along[..., None] * direction, plane, atol=1e-8)
        corners.append(start[0, 0])
    assert np.linalg.norm(corners[0] - corners[2]) > 1.0


def test_without_a_compiler_a_scene_is_refused(small_layout: Layout) -> None:
    with pytest.raises(InputError, match=r"^a scene in colour needs a GPU or an LLVM"):
        TabletopScene(small_layout, arrange_tabletop(small_layout, (400.0,), 0), 0.9, variant=SCALAR)
