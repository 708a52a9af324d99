"""Files of the ground truth: written only where they apply, and read back unchanged.

A whole set: the same request, the same bytes; whole files or none; the truth in its own folder.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from mirrorcam.core.disk.files import TEMPORARY
from mirrorcam.core.disk.fingerprint import file_digest
from mirrorcam.core.disk.resumable import UNFINISHED
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import read_image
from mirrorcam.core.progress import Progress, no_progress
from mirrorcam.optics.geometry.boards import Charuco, Checkerboard, load_board
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.tolerances import Tolerances
from mirrorcam.render_scenes.mirror_finish import uniform_finishes
from mirrorcam.render_scenes.sets.dataset import MANIFEST, TRUTH, Dataset
from mirrorcam.render_scenes.sets.poses import plan_base_frames, plan_frames
from mirrorcam.render_scenes.sets.render_set import render_set, write_truth
from mirrorcam.render_scenes.sets.set_request import SetRequest
from mirrorcam.render_scenes.settings import SENSORS, RenderSettings, SensorModel
from mirrorcam.render_scenes.truth.corners import CornerProjector


def test_the_truth_is_read_back_as_it_was(small_layout: Layout, small_board: Charuco, tmp_path: Path) -> None:
    random = np.random.default_rng(1)
    base = plan_base_frames(small_layout, small_board, 1, random)
    moments = plan_frames(small_layout, small_board, 2, random).poses[:, None]
    projector = CornerProjector(small_layout, small_board)
    write_truth(tmp_path / "still", projector, (), None, moments, base, 7)
    finishes = uniform_finishes(RenderSettings(), 9)
    write_truth(tmp_path / "moving", projector, finishes, None, np.repeat(moments, 3, axis=1), base, 7)
    for folder, names in (("still", TRUTH[:-3]), ("moving", TRUTH[:-1])):
        files = {path.relative_to(tmp_path / folder).as_posix() for path in (tmp_path / folder).rglob("*.*")}
        assert files == set(names)
    truth = tmp_path / "still" / "truth"
    poses = json.loads((truth / "poses.json").read_text(encoding="utf-8"))
    np.testing.assert_array_equal(poses["frames"], moments[:, 0])
    np.testing.assert_array_equal(poses["base"], base.poses)
    corners = np.load(truth / "corners.npz")
    np.testing.assert_array_equal(corners["frames_px"][1], projector.via_mirrors(moments[1, 0])[0])
    assert Layout.load(truth / "layout.json") == small_layout


FRAMES, BASE = 3, 2
Render = Callable[..., Dataset]


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


@pytest.fixture(scope="module")
def render(small_layout: Layout, small_board: Charuco) -> Render:
    def call(out: Path, *, progress: Progress = no_progress, **changes: object) -> Dataset:
        request = SetRequest(
            layout=small_layout,
            board=small_board,
            frames=FRAMES,
            base_frames=BASE,
            seed=7,
            tolerances=Tolerances(centre_px=2.0),
            settings=RenderSettings(spp=4, sensor=SensorModel()),
        )
        return render_set(request.replaced(**changes), out, progress=progress)

    return call


@pytest.fixture(scope="module")
def finished(render: Render, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("sets") / "set"
    render(out)
    return out


def test_a_set_holds_what_was_promised(finished: Path, small_layout: Layout, small_board: Charuco) -> None:
    dataset = Dataset.load(finished)
    assert set(dataset.files) <= set(dataset.planned_names)
    assert set(contents(finished)) == {
        MANIFEST,
        "layout.json",
        "board.toml",
        *(f"frames/{index:04d}.png" for index in range(FRAMES)),
        *(f"base/{index:04d}.png" for index in range(BASE)),
        *(f"truth/{name}" for name in ("layout.json", "poses.json", "seed.json", "corners.npz")),
        *(f"truth/maps/frames/{index:04d}.exr" for index in range(FRAMES)),
        *(f"truth/maps/base/{index:04d}.exr" for index in range(BASE)),
    }
    assert dataset.complete
    assert set(dataset.files) == set(contents(finished)) - {MANIFEST}
    assert all(dataset.intact(finished, name) for name in dataset.files)
    assert Layout.load(finished / "layout.json") == small_layout
    assert load_board(finished / "board.toml") == small_board
    for name in (*dataset.frame_names, *dataset.base_names):
        picture = read_image(finished / name, grey=True)
        assert picture.shape == (270, 480)
        assert picture.max() < 255
        assert np.ptp(picture) > 150
    assert min(dataset.coverage) > 0.3
    assert 0.2 < dataset.base_coverage <= 1.0


def test_the_truth_is_that_of_the_camera_as_built(finished: Path, small_layout: Layout, small_board: Charuco) -> None:
    built = Layout.load(finished / "truth" / "layout.json")
    assert built.kind == "as-built"
    assert built.identity != small_layout.identity
    poses = json.loads((finished / "truth" / "poses.json").read_text(encoding="utf-8"))
    assert np.shape(poses["frames"]) == (FRAMES, 4, 4)
    assert np.shape(poses["base"]) == (BASE, 4, 4)
    corners = np.load(finished / "truth" / "corners.npz")
    assert corners["frames_px"].shape == (FRAMES, 9, 54, 2)
    assert corners["base_px"].shape == (BASE, 54, 2)
    projector = CornerProjector(built, small_board)
    for frame in range(FRAMES):
        px, visible = projector.via_mirrors(np.array(poses["frames"][frame]))
        np.testing.assert_array_equal(corners["frames_px"][frame], px)
        np.testing.assert_array_equal(corners["frames_visible"][frame], visible)
    np.testing.assert_array_equal(corners["base_visible"][1], projector.direct(np.array(poses["base"][1]))[1])


def test_pictures_show_the_board_where_the_truth_says(finished: Path, small_board: Charuco) -> None:
    corners = np.load(finished / "truth" / "corners.npz")
    for frame in range(FRAMES):
        picture = read_image(finished / f"frames/{frame:04d}.png", grey=True).astype(float)
        seen = corners["frames_px"][frame][corners["frames_visible"][frame]]
        assert len(seen) > 50
        for x, y in np.round(seen).astype(int):
            # Around a corner of a checkerboard half is black and half is white.
            window = picture[max(y - 2, 0) : y + 3, max(x - 2, 0) : x + 3]
            assert 60 < window.mean() < 150


def test_nothing_outside_the_truth_tells_the_truth(finished: Path) -> None:
    truth = json.loads((finished / "truth" / "layout.json").read_text(encoding="utf-8"))
    written = (finished / MANIFEST).read_text(encoding="utf-8") + (finished / "layout.json").read_text(encoding="utf-8")
    assert repr(truth["camera"]["fx_px"]) not in written
    assert repr(truth["mirrors"][0]["virtual_centre_in_rig_mm"][0]) not in written
    assert "seed" not in json.loads((finished / MANIFEST).read_text(encoding="utf-8"))


def test_the_same_request_gives_the_same_bytes(render: Render, finished: Path, tmp_path: Path) -> None:
    render(tmp_path / "again")
    assert contents(tmp_path / "again") == contents(finished)


def test_another_seed_gives_another_set(render: Render, finished: Path, tmp_path: Path) -> None:
    render(tmp_path / "other", seed=8, frames=1, base_frames=1)
    first, other = contents(finished), contents(tmp_path / "other")
    for name in ("frames/0000.png", "base/0000.png", "truth/layout.json", "truth/poses.json"):
        assert first[name] != other[name]


def test_an_interrupted_set_is_continued(render: Render, finished: Path, tmp_path: Path) -> None:
    out = tmp_path / "set"

    def interrupt(done: int, total: int) -> None:
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        render(out, progress=interrupt)
    dataset = Dataset.load(out)
    assert not dataset.complete
    assert [name for name in dataset.files if name.startswith("frames")] == ["frames/0000.png", "frames/0001.png"]
    assert not (out / "frames" / "0002.png").exists()
    written = (out / "frames" / "0000.png").stat().st_mtime_ns
    (out / "frames" / "0001.png").unlink()
    (out / UNFINISHED).mkdir()
    (out / UNFINISHED / "killed.png").write_bytes(b"left over by a killed run")
    calls: list[tuple[int, int]] = []
    render(out, progress=lambda done, total: calls.append((done, total)))
    assert calls == [(done, FRAMES + BASE) for done in range(1, FRAMES + BASE + 1)]
    assert (out / "frames" / "0000.png").stat().st_mtime_ns == written
    assert contents(out) == contents(finished)


@pytest.mark.slow
def test_whenever_it_is_killed_what_is_there_is_whole_and_the_rest_follows(
    render: Render, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    small: dict[str, object] = {"frames": 2, "base_frames": 1, "rate_hz": 10.0}
    small["settings"] = RenderSettings(renderer="fast", sensor=SENSORS["c920"], video="avi", maps=False)
    render(tmp_path / "whole", **small)
    whole, put_in_place = contents(tmp_path / "whole"), Path.replace

    def end_at(write: int) -> Callable[[Path, Path], Path]:
        writes = iter(range(write + 1))

        def replace(temporary: Path, target: Path) -> Path:
            if next(writes) == write:
                # The temporary file that a killed process leaves.
                (temporary.parent / f"{TEMPORARY}left{target.suffix}").write_bytes(temporary.read_bytes()[:99])
                raise KeyboardInterrupt
            return put_in_place(temporary, target)

        return replace

    ended = 0
    for write in range(100):
        out = tmp_path / f"ended at {write}"
        monkeypatch.setattr(Path, "replace", end_at(write))
        try:
            render(out, **small)
        except KeyboardInterrupt:
            ended += 1
        else:
            break
        finally:
            monkeypatch.setattr(Path, "replace", put_in_place)
        for name, content in contents(out).items():
            if name == MANIFEST:
                dataset = Dataset.load(out)
                there = [recorded for recorded in dataset.files if (out / recorded).exists()]
                assert len(there) >= len(dataset.files) - 5
                assert all(dataset.intact(out, recorded) for recorded in there)
            elif not name.startswith("."):
                assert content == whole[name], name
        if write % 4 == 0 or (out / "video.avi").exists():
            render(out, **small)
            assert contents(out) == whole
    # The manifest after each other write, and each file.
    assert ended > len(whole) + 4


def test_a_finished_set_renders_nothing_again(render: Render, finished: Path) -> None:
    before = {path: path.stat().st_mtime_ns for path in finished.glob("*/*.png")}
    calls: list[tuple[int, int]] = []
    render(finished, progress=lambda done, total: calls.append((done, total)))
    assert calls == [(FRAMES + BASE, FRAMES + BASE)]
    assert {path: path.stat().st_mtime_ns for path in finished.glob("*/*.png")} == before


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"seed": 8}, "seed"),
        ({"settings": RenderSettings(spp=9, sensor=SensorModel())}, "settings"),
        ({"frames": FRAMES + 1}, "frames"),
        ({"tolerances": Tolerances(tilt_deg=0.1)}, "tolerances"),
        ({"settings": RenderSettings(spp=4, sensor=SensorModel(lens_blur_px=1.1))}, "settings"),
    ],
)
def test_another_request_in_the_same_folder_is_refused(
    render: Render, finished: Path, changes: dict[str, object], named: str
) -> None:
    before = contents(finished)
    with pytest.raises(InputError, match=f"holds a set that differs in {named}"):
        render(finished, **changes)
    assert contents(finished) == before


def test_a_folder_of_someone_else_is_left_alone(render: Render, tmp_path: Path) -> None:
    (tmp_path / "frames").mkdir()
    (tmp_path / "frames" / "holiday.png").write_bytes(b"mine")
    with pytest.raises(InputError, match=r"has 'frames' but no dataset\.json"):
        render(tmp_path)
    assert set(contents(tmp_path)) == {"frames/holiday.png"}
    (tmp_path / "file").write_bytes(b"mine")
    with pytest.raises(InputError, match="is a file"):
        render(tmp_path / "file")


@pytest.mark.parametrize(
    "changes",
    [
        {"board": Checkerboard(cols=20, rows=14, square_mm=2.0)},
        {"tolerances": Tolerances(tilt_deg=30.0)},
        {"poses": (tuple(map(tuple, np.eye(4).tolist())),)},
    ],
    ids=["a board too small", "mirrors that cut each other", "poses that no mirror shows"],
)
def test_a_refusal_leaves_nothing_behind(render: Render, changes: dict[str, object], tmp_path: Path) -> None:
    with pytest.raises(InputError) as error:
        render(tmp_path / "set", **changes)
    assert "\n" not in str(error.value)
    assert not (tmp_path / "set").exists()


def test_a_checkerboard_and_frames_alone_are_rendered_too(render: Render, small_layout: Layout, tmp_path: Path) -> None:
    dataset = render(
        tmp_path / "set",
        board=Checkerboard(cols=10, rows=7, square_mm=24.0),
        frames=1,
        base_frames=0,
        tolerances=Tolerances.none(),
        settings=RenderSettings(spp=3, maps=False),
    )
    assert dataset.complete
    assert dataset.files["frames/0000.jpg"] == file_digest(tmp_path / "set" / "frames" / "0000.jpg")
    assert not (tmp_path / "set" / "truth" / "maps").exists()
    # The true camera has the pupil of the pictures.
    built = Layout.load(tmp_path / "set" / "truth" / "layout.json")
    assert built.camera == small_layout.camera.with_pupil(SENSORS["c920"].pupil)


MOVING: dict[str, object] = {
    "frames": 5,
    "base_frames": 1,
    "rate_hz": 10.0,
    "settings": RenderSettings(renderer="fast", sensor=SENSORS["c920"], video="mp4", maps=False),
}


@pytest.mark.slow
def test_a_video_that_is_interrupted_is_encoded_again_from_the_finished_frames(render: Render, tmp_path: Path) -> None:
    def interrupt(done: int, total: int) -> None:
        assert total == 5 + 1 + 5
        if done == 8:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        render(tmp_path / "set", progress=interrupt, **MOVING)
    before = contents(tmp_path / "set")
    assert not any(name.endswith(".mp4") for name in before)
    assert Dataset.load(tmp_path / "set").missing == ("video.mp4",)
    calls: list[int] = []
    dataset = render(tmp_path / "set", progress=lambda done, total: calls.append(done), **MOVING)
    assert calls == [6, 7, 8, 9, 10, 11]
    assert dataset.complete
    assert dataset.files["video.mp4"] == file_digest(tmp_path / "set" / "video.mp4")
    render(tmp_path / "at once", **MOVING)
    assert contents(tmp_path / "at once") == contents(tmp_path / "set")
    calls.clear()
    render(tmp_path / "set", progress=lambda done, total: calls.append(done), **MOVING)
    assert calls == [11]


@pytest.mark.slow
def test_frames_of_a_motion_follow_each_other(render: Render, tmp_path: Path) -> None:
    slow = render(tmp_path / "set", **(MOVING | {"rate_hz": 100.0}))
    poses = np.array(json.loads((tmp_path / "set" / "truth" / "poses.json").read_text(encoding="utf-8"))["frames"])
    assert slow.rate_hz == 100.0
    # 40 ms of a motion of one pose a second, which starts at rest.
    steps = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    assert 0.0 < steps[0] < steps[-1] < 5.0


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"rate_hz": None}, "video mp4"),
        ({"settings": RenderSettings(sensor=SENSORS["ideal"], video="avi")}, "video avi"),
        ({"frames": 1}, "rate_hz: one pose is not a motion"),
    ],
)
def test_what_makes_no_video_is_refused(
    render: Render, tmp_path: Path, changes: dict[str, object], complaint: str
) -> None:
    with pytest.raises(InputError, match=complaint):
        render(tmp_path / "set", **(MOVING | changes))
    assert not (tmp_path / "set").exists()


@pytest.mark.parametrize("sensor", [SENSORS["c920"], SensorModel(h264_crf=20)], ids=["video", "sensor"])
def test_h264_wants_even_sides(render: Render, small_layout: Layout, tmp_path: Path, sensor: SensorModel) -> None:
    odd = small_layout.replaced(camera=small_layout.camera.replaced(width_px=479))
    video = "mp4" if sensor.h264_crf is None else None
    settings = RenderSettings(renderer="fast", sensor=sensor, video=video)
    with pytest.raises(InputError, match=r"H\.264: a sensor of 479 x 270 pixels, expected even numbers"):
        render(tmp_path / "set", **(MOVING | {"layout": odd, "settings": settings}))


def test_the_manifest_holds_every_parameter(render: Render, tmp_path: Path) -> None:
    sensor = SENSORS["poor"].replaced(focus_mm=432.1, exposure=0.7)
    settings = RenderSettings(renderer="fast", spp=9, paper=0.8, ink=0.04, sensor=sensor, maps=False)
    render(tmp_path / "set", frames=1, base_frames=0, settings=settings)
    written = json.loads((tmp_path / "set" / MANIFEST).read_text(encoding="utf-8"))
    assert written["settings"]["sensor"] == sensor.model_dump(mode="json")
    assert set(written["settings"]) == set(RenderSettings.model_fields)
    assert written["settings"] == settings.model_dump(mode="json")
