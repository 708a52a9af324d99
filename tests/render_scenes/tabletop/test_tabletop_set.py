"""A tabletop set: its frame, decoded, against its true views; its depths against rays; and its files."""

from __future__ import annotations

import hashlib
import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest
from numpy.typing import NDArray

from mirrorcam.core.disk.resumable import UNFINISHED
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import read_image
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.tolerances import Tolerances
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.optics.light_field.light_field import Views
from mirrorcam.render_scenes.settings import SENSORS
from mirrorcam.render_scenes.tabletop.tabletop import UserMesh
from mirrorcam.render_scenes.tabletop.tabletop_set import (
    MANIFEST,
    MAPS,
    MASK,
    TabletopRequest,
    TabletopSet,
    _views,
    default_depths_mm,
    read_map,
    render_tabletop,
)
from mirrorcam.render_scenes.truth.pixel_maps import exr_bytes
from mirrorcam.render_scenes.variant import SCALAR, use_variant
from tests.shared import built_once

KINDS = {"views": ".png", "depth": ".exr", "disparity": ".exr", "mask": ".png", "things": ".png"}


def contents(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def exr(path: Path) -> dict[str, FloatArray]:
    with OpenEXR.File(str(path), separate_channels=True) as file:
        return {name: np.array(channel.pixels, dtype=np.float64) for name, channel in file.channels().items()}


def test_maps_are_read_back_or_refused_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "map.exr"
    path.write_bytes(exr_bytes({"depth": np.array([[1.0, np.inf, 0.1]])}, {"units": "mm"}))
    assert read_map(path, "depth").tolist() == [[1.0, np.inf, np.float32(0.1)]]
    with pytest.raises(InputError, match=r"map\.exr: not a readable EXR file with a channel 'width'$"):
        read_map(path, "width")
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(InputError, match=r"map\.exr: not a readable EXR file with a channel 'depth'$"):
        read_map(path, "depth")
    with pytest.raises(InputError, match=r"gone\.exr: no such file"):
        read_map(tmp_path / "gone.exr", "depth")


@pytest.fixture(scope="module")
def asked(small_layout: Layout) -> TabletopRequest:
    """A tabletop scene through the default mirrors, built by a hobbyist, with a sensor of 480 x 270 pixels."""
    if use_variant(colour=True) == SCALAR:
        pytest.skip("nothing compiles in colour")
    return TabletopRequest(
        layout=small_layout, seed=11, tolerances=Tolerances(centre_px=2.0), sensor=SENSORS["ideal"], spp=16
    )


@pytest.fixture(scope="module")
def finished(asked: TabletopRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return built_once(tmp_path_factory, "tabletop_set", lambda folder: render_tabletop(asked, folder))


@pytest.fixture(scope="module")
def built(finished: Path) -> Layout:
    return Layout.load(finished / "truth/layout.json")


@pytest.fixture(scope="module")
def views(built: Layout) -> Views:
    """Grid of views decoded with the layout as built, to which the true views must conform."""
    return Decoder(built).views


def test_a_set_holds_what_was_promised(finished: Path, asked: TabletopRequest) -> None:
    manifest = TabletopSet.load(finished)
    truths = {f"truth/{kind}/{t}_{s}{end}" for kind, end in KINDS.items() for t in range(3) for s in range(3)}
    known = {MAPS, "frames/0000.png", "layout.json", "truth/layout.json", "truth/things.json"}
    assert set(contents(finished)) == truths | known | {MANIFEST}
    assert set(manifest.files) == truths | known
    assert manifest.depths_mm == pytest.approx((300.0, 375.0, 500.0))
    assert Layout.load(finished / "layout.json") == asked.layout
    assert read_image(finished / "frames/0000.png").shape == (270, 480, 3)
    assert (finished / MANIFEST).read_text(encoding="utf-8").count("seed") == 0


def shift_px(found: FloatArray, expected: FloatArray, inside: NDArray[np.bool_]) -> FloatArray:
    """Mean shift (u, v) in px of one picture (v, u) against another, by least squares on gradients."""
    slopes = np.stack([np.asarray(np.gradient(expected, axis=axis))[inside] for axis in (1, 0)], axis=1)
    less = (expected - found)[inside]
    return np.asarray(np.linalg.solve(slopes.T @ slopes, slopes.T @ less))


def compared(folder: Path, decoder: Decoder) -> tuple[list[float], list[float], list[float]]:
    """Per view, decoded against true: PSNR in dB, PSNR with the truth blurred as the decoded view is, shift in px."""
    light_field = decoder.decode(read_image(folder / "frames/0000.png"))
    sharp: list[float] = []
    soft: list[float] = []
    shifts: list[float] = []
    for t, s in np.ndindex(3, 3):
        decoded = light_field.samples[t, s].astype(np.float64)
        true = read_image(folder / f"truth/views/{t}_{s}.png").astype(np.float64)
        assert decoded.shape == true.shape
        inside = cv2.erode(
            light_field.valid[t, s].astype(np.uint8), np.ones((7, 7)), borderType=cv2.BORDER_CONSTANT, borderValue=0
        ).astype(bool)
        # The lens blurs highlights before the sensor clips them, so that they are larger than those of a true view.
        inside &= ~cv2.dilate((true.max(axis=-1) >= 255.0).astype(np.uint8), np.ones((13, 13))).astype(bool)
        # The blur of the lens (0.8 px) and of interpolation in decoding.
        blurred = np.asarray(cv2.GaussianBlur(true, (0, 0), 0.95))
        for errors, picture in ((sharp, true), (soft, blurred)):
            errors.append(20.0 * np.log10(255.0 / np.sqrt(np.mean(np.square(decoded - picture)[inside]))))
        shifts.append(float(np.abs(shift_px(decoded.mean(axis=-1), blurred.mean(axis=-1), inside)).max()))
    return sharp, soft, shifts


def test_a_decoded_frame_is_the_true_views(finished: Path, built: Layout) -> None:
    sharp, soft, shifts = compared(finished, Decoder(built))
    assert min(sharp) > 22.5
    assert min(soft) > 30.0
    assert max(shifts) < 0.06


@pytest.mark.slow
def test_a_decoded_frame_of_a_webcam_is_the_true_views(default_layout: Layout, tmp_path: Path) -> None:
    request = TabletopRequest(layout=default_layout, seed=1, sensor=SENSORS["ideal"], spp=16)
    render_tabletop(request, tmp_path / "scene")
    sharp, soft, shifts = compared(tmp_path / "scene", Decoder(Layout.load(tmp_path / "scene/truth/layout.json")))
    assert min(sharp) > 25.5
    assert min(soft) > 37.0
    assert max(shifts) < 0.02


def test_decoding_as_designed_instead_of_as_built_is_noticed(
    finished: Path, asked: TabletopRequest, built: Layout
) -> None:
    # The same grid but other mirrors: views no longer match.
    designed = built.replaced(mirrors=asked.layout.mirrors)
    width, height = Decoder(built).views.width_px, Decoder(built).views.height_px
    views = Decoder(designed).views
    assert abs(views.width_px - width) < 8
    light_field = Decoder(designed).decode(read_image(finished / "frames/0000.png"))
    shifts = []
    for t, s in np.ndindex(3, 3):
        rows, columns = min(height, views.height_px), min(width, views.width_px)
        decoded = light_field.samples[t, s, :rows, :columns].mean(axis=-1)
        true = read_image(finished / f"truth/views/{t}_{s}.png")[:rows, :columns].mean(axis=-1)
        inside = light_field.valid[t, s, :rows, :columns]
        shifts.append(float(np.abs(shift_px(decoded, cv2.GaussianBlur(true, (0, 0), 0.95), inside)).max()))
    assert max(shifts) > 0.3


def rays_of(views: Views, t: int, s: int) -> tuple[FloatArray, FloatArray]:
    """Centre (3,) and directions (v, u, 3) of a view's pixels in view axes from the pupil, by its intrinsic matrix."""
    pixels = np.concatenate([views.pixel_grid(), np.ones((views.height_px, views.width_px, 1))], axis=-1)
    centre = views.view_from_rig @ views.reference_view_in_rig_mm + views.positions_mm[t, s]
    return centre, pixels @ np.linalg.inv(views.matrices[t, s]).T


def analytic_depth(item: dict[str, object], centre: FloatArray, ways: FloatArray) -> FloatArray:
    """Depth (v, u) at which rays first meet a ball or a flat picture; infinite where they miss it."""
    view_from_object, size = np.array(item["view_from_thing"]), np.array(item["size_mm"])
    start = (centre - view_from_object[:3, 3]) @ view_from_object[:3, :3]
    direction = ways @ view_from_object[:3, :3]
    with np.errstate(invalid="ignore", divide="ignore"):
        if item["kind"] == "sphere":
            a, b = np.square(direction).sum(axis=-1), direction @ start
            part = (-b - np.sqrt(b * b - a * (start @ start - (size[0] / 2.0) ** 2))) / a
            met = np.isfinite(part)
        else:
            part = -start[2] / direction[..., 2]
            at = start[:2] + part[..., None] * direction[..., :2]
            met = (np.abs(at) <= size[:2] / 2.0).all(axis=-1)
        return np.where(met & (part > 0.0), centre[2] + part * ways[..., 2], np.inf)


@pytest.mark.parametrize(("t", "s"), [(1, 1), (0, 0), (2, 1)])
def test_depths_are_those_of_rays_in_double_precision(finished: Path, views: Views, t: int, s: int) -> None:
    objects = json.loads((finished / "truth/things.json").read_text(encoding="utf-8"))["things"]
    depth = exr(finished / f"truth/depth/{t}_{s}.exr")["depth"]
    labels = read_image(finished / f"truth/things/{t}_{s}.png", grey=True)
    centre, ways = rays_of(views, t, s)
    known = {number: item for number, item in enumerate(objects, start=1) if item["kind"] in ("sphere", "rectangle")}
    expected = {number: analytic_depth(item, centre, ways) for number, item in known.items()}
    seen = 0
    for number in known:
        here = labels == number
        seen += int(here.sum() > 20)
        # At an edge that single precision displaces, the analytic ray misses; this occurs on the rim only.
        missed = here & ~np.isfinite(expected[number])
        assert missed.sum() <= 2, objects[number - 1]["name"]
        error = np.abs(depth - expected[number])[here & ~missed]
        # A ray that grazes a ball, or the desk, magnifies the rounding of its start.
        assert np.quantile(error, 0.99) < 2e-3, objects[number - 1]["name"]
        assert error.max() < 0.2, objects[number - 1]["name"]
    assert seen == 6  # wall, desk, page and three balls
    # No analytic object is hidden by one behind it.
    nearest = np.min(list(expected.values()), axis=0)
    assert (depth <= nearest + 0.2).all()


def test_masks_tell_what_is_glossy_or_transparent(finished: Path) -> None:
    objects = json.loads((finished / "truth/things.json").read_text(encoding="utf-8"))["things"]
    materials = np.array([MASK["nothing"], *(MASK[item["material"]] for item in objects)])
    counts = np.zeros(4, dtype=int)
    for t, s in np.ndindex(3, 3):
        labels = read_image(finished / f"truth/things/{t}_{s}.png", grey=True)
        mask = read_image(finished / f"truth/mask/{t}_{s}.png", grey=True)
        assert np.array_equal(mask, materials[labels])
        counts += np.bincount(mask.ravel(), minlength=4)
    assert counts[MASK["nothing"]] == 0
    assert counts[MASK["glossy"]] > 9 * 100
    assert counts[MASK["glass"]] > 9 * 100


def test_disparity_moves_things_from_view_to_view(finished: Path, views: Views) -> None:
    depth = exr(finished / "truth/depth/1_1.exr")["depth"]
    disparity = exr(finished / "truth/disparity/1_1.exr")
    centre, ways = rays_of(views, 1, 1)
    points = centre + ways * ((depth - centre[2]) / ways[..., 2])[..., None]
    seen = views.project(points @ views.view_from_rig)
    across, down = views.positions_mm[1, :, 0], views.positions_mm[:, 1, 1]
    along_s = -(seen[1, 2, ..., 0] - seen[1, 0, ..., 0]) / (across[2] - across[0]) * views.step_mm("s")
    along_t = -(seen[2, 1, ..., 1] - seen[0, 1, ..., 1]) / (down[2] - down[0]) * views.step_mm("t")
    # Depths of views a millimetre nearer or farther than the reference differ by 1 mm in some 100 mm.
    assert np.abs(disparity["s"] - along_s).max() < 0.15
    assert np.abs(disparity["t"] - along_t).max() < 0.3
    nearer = depth < views.reference_depth_mm
    assert (disparity["s"][nearer] > 0).all()
    assert (disparity["s"][~nearer] <= 0).all()
    assert np.abs(disparity["s"]).max() > 3.0


def test_pixels_of_the_frame_are_told_as_the_views_see_them(finished: Path, built: Layout, views: Views) -> None:
    maps = exr(finished / MAPS)
    assert {name: values.shape for name, values in maps.items()} == dict.fromkeys(
        ("mirror", "thing", "depth", "path"), (270, 480)
    )
    depth = exr(finished / "truth/depth/1_1.exr")["depth"]
    centre, ways = rays_of(views, 1, 1)
    points = (centre + ways * ((depth - centre[2]) / ways[..., 2])[..., None]) @ built.view_from_rig
    # Frame pixel of a central view's pixel: its mirror, its depth, and the path of its light.
    at = built.project(points, 4)
    u, v = np.clip(np.rint(at), 0, [479, 269]).astype(int).reshape(-1, 2).T
    flat = depth.ravel()
    # Away from edges, where half a pixel shows another object.
    shown = Decoder(built).weights[1, 1].ravel() > 0
    assert (maps["mirror"][v, u][shown] == 4.0).all()
    plain = shown & (np.abs(maps["depth"][v, u] - flat) < 5.0)
    assert plain.sum() > 0.9 * shown.sum()
    assert np.median(np.abs(maps["depth"][v, u] - flat)[plain]) < 0.3
    direction = np.linalg.norm(built.mirrors[4].reflect(points.reshape(-1, 3)), axis=-1)
    assert np.median(np.abs(maps["path"][v, u] - direction)[plain]) < 0.5
    assert (maps["mirror"] == -1.0).any()
    assert np.isnan(maps["depth"][maps["mirror"] == -1.0]).all()
    assert (maps["thing"][maps["mirror"] == -1.0] == 0.0).all()


def test_truth_says_what_it_is_of(finished: Path, built: Layout) -> None:
    with OpenEXR.File(str(finished / "truth/depth/0_2.exr")) as file:
        header = dict(file.header())
    assert header["layout"] == built.identity
    assert header["view"] == "0_2"
    assert "mm" in header["units"]


@pytest.mark.slow
def test_an_interrupted_set_is_continued_to_the_same_bytes(
    finished: Path, asked: TabletopRequest, tmp_path: Path
) -> None:
    out = tmp_path / "scene"
    shutil.copytree(finished, out)
    (out / "truth/depth/1_2.exr").unlink()
    (out / "frames/0000.png").unlink()
    (out / UNFINISHED).mkdir()
    (out / UNFINISHED / "left.png").write_bytes(b"over")
    heard: list[tuple[int, int]] = []
    render_tabletop(asked, out, progress=lambda done, total: heard.append((done, total)))
    assert contents(out) == contents(finished)
    assert heard == [(done, 10) for done in range(11)]


def test_other_requests_leave_a_set_alone(finished: Path, asked: TabletopRequest, tmp_path: Path) -> None:
    before = contents(finished)
    with pytest.raises(
        InputError, match=r"holds a scene that differs in spp, expected the same request or a new folder$"
    ):
        render_tabletop(asked.replaced(spp=32), finished)
    with pytest.raises(
        InputError, match=r"holds a scene that differs in seed \(or by another version of this program\)"
    ):
        render_tabletop(asked.replaced(seed=12), finished)
    assert contents(finished) == before
    (tmp_path / "truth").mkdir()
    with pytest.raises(InputError, match=r"has 'truth' but no scene.json, expected a new or empty folder$"):
        render_tabletop(asked, tmp_path)
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(InputError, match=r"file: is a file, expected a folder for the scene$"):
        render_tabletop(asked, tmp_path / "file")
    with pytest.raises(InputError, match=r"^a scene is one picture, expected a sensor without h264_crf$"):
        render_tabletop(asked.replaced(sensor=SENSORS["ideal"].replaced(h264_crf=20)), tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_a_mesh_of_the_user_stands_on_the_desk(asked: TabletopRequest, tmp_path: Path) -> None:
    block = tmp_path / "block.obj"
    corners = [(x, y, z) for z in (7.0, 37.0) for y in (0.0, 10.0) for x in (100.0, 120.0)]
    quads = [(1, 3, 4, 2), (5, 6, 8, 7), (1, 2, 6, 5), (2, 4, 8, 6), (4, 3, 7, 8), (3, 1, 5, 7)]
    text = "".join("v {} {} {}\n".format(*corner) for corner in corners)
    block.write_text(text + "".join("f {} {} {} {}\n".format(*quad) for quad in quads), encoding="utf-8")
    place = np.array([5.0, -40.0, 290.0])
    request = asked.replaced(meshes=(UserMesh(file=block, position_in_view_mm=place),), spp=4)
    manifest = render_tabletop(request, tmp_path / "scene")
    assert manifest.meshes == (("block.obj", hashlib.sha256(block.read_bytes()).hexdigest()),)
    views = Decoder(Layout.load(tmp_path / "scene/truth/layout.json")).views
    labels = read_image(tmp_path / "scene/truth/things/1_1.png", grey=True)
    depth = exr(tmp_path / "scene/truth/depth/1_1.exr")["depth"]
    # The front of the block: x -10..10, y -30..0, z -5 of its base's middle.
    middle = views.project((place - np.array([0.0, 15.0, 5.0])) @ views.view_from_rig)[1, 1]
    u, v = np.rint(middle).astype(int)
    assert labels[v, u] == labels.max() == 10
    assert depth[v, u] == pytest.approx(285.0, abs=1e-3)
    # 20 x 30 mm at that distance, in px.
    px_per_mm = views.focal_px / (285.0 - views.view_from_rig[2] @ views.reference_view_in_rig_mm)
    assert (labels == 10).sum() == pytest.approx(20.0 * 30.0 * px_per_mm**2, rel=0.15)


def test_second_surface_mirrors_have_the_views_of_their_apparent_mirrors(small_layout: Layout) -> None:
    plates = tuple(mirror.replaced(surface="second", thickness_mm=2.0) for mirror in small_layout.mirrors)
    built = small_layout.replaced(mirrors=plates)
    views = _views(built, 375.0)
    assert np.array_equal(views.reference_view_in_rig_mm, built.virtual_centres_in_rig_mm[4])
    assert views.layout_identity == built.identity
    plain = Decoder(built.replaced(mirrors=tuple(mirror.apparent for mirror in plates))).views
    assert (views.width_px, views.height_px, views.focal_px) == (plain.width_px, plain.height_px, plain.focal_px)


def test_one_mirror_has_a_true_view_and_no_disparity(asked: TabletopRequest, tmp_path: Path) -> None:
    alone = asked.layout.replaced(rows=1, cols=1, mirrors=asked.layout.mirrors[4:5])
    manifest = render_tabletop(asked.replaced(layout=alone, spp=4), tmp_path / "scene")
    views = {name for name in manifest.files if name.startswith("truth/") and name.count("/") == 2}
    assert views == {f"truth/{kind}/0_0{end}" for kind, end in KINDS.items() if kind != "disparity"}


def test_depths_come_from_the_spec_where_there_is_one(default_layout: Layout) -> None:
    assert default_depths_mm(default_layout) == pytest.approx((300.0, 375.0, 500.0))
    assert default_depths_mm(default_layout.replaced(spec=None)) == pytest.approx((320.0, 400.0, 533.33), abs=0.01)
