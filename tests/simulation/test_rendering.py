"""Sets rendered by workers are the same to the byte; scenes and pictures of a device become files."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
from collections.abc import Iterator, Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from mirrorcam.core.disk.files import write_bytes
from mirrorcam.core.disk.fingerprint import file_digest
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import read_image, write_image
from mirrorcam.core.processes.worker_pool import run_local
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.sets.render_set import render_set
from mirrorcam.render_scenes.sets.set_request import SetRequest
from mirrorcam.render_scenes.settings import SENSORS, RenderSettings
from mirrorcam.render_scenes.tabletop.tabletop_set import TabletopRequest
from mirrorcam.render_scenes.truth.pixel_maps import exr_bytes
from mirrorcam.simulation import rendering
from mirrorcam.simulation.rendering import (
    GAP_PX,
    HEIGHT_PX,
    SetCheck,
    check_set,
    in_workers,
    on_cluster,
    overview,
    write_scene,
    yield_frames,
)
from tests.nightly import a_few
from tests.render_scenes.manifests import dataset_of_two_frames, scene_of_two_depths
from tests.small_set import contents

# Not by importing it: that would choose an LLVM.
rendered = pytest.mark.skipif(find_spec("mitsuba") is None, reason="rendering needs the extra render")


@rendered
@pytest.mark.parametrize("workers", a_few(1, [1, 2]))
def test_the_bytes_do_not_depend_on_the_number_of_workers(
    workers: int, set_request: SetRequest, finished_set: Path, tmp_path: Path
) -> None:
    render_set(set_request, tmp_path / "set", run=in_workers(workers))
    assert contents(tmp_path / "set") == contents(finished_set)


@pytest.mark.slow
@rendered
@pytest.mark.parametrize("surface", ["first", "second"])
def test_the_reference_gives_the_same_bytes_by_workers(surface: str, set_request: SetRequest, tmp_path: Path) -> None:
    layout = set_request.layout
    mirrors = tuple(mirror.replaced(surface=surface, thickness_mm=2.0) for mirror in layout.mirrors)
    request = set_request.replaced(
        layout=layout.replaced(mirrors=mirrors), frames=2, base_frames=1, settings=RenderSettings(spp=4)
    )
    render_set(request, tmp_path / "by workers", run=in_workers(2))
    render_set(request, tmp_path / "here")
    assert contents(tmp_path / "by workers") == contents(tmp_path / "here")


@pytest.mark.slow
@rendered
def test_a_killed_worker_loses_nothing(set_request: SetRequest, finished_set: Path, tmp_path: Path) -> None:
    killed: list[int | None] = []

    def kill_one(done: int, total: int) -> None:
        if done == 2:
            worker = multiprocessing.active_children()[0]
            killed.append(worker.pid)
            worker.kill()

    render_set(set_request, tmp_path / "set", run=in_workers(2), progress=kill_one)
    assert len(killed) == 1
    assert contents(tmp_path / "set") == contents(finished_set)


def leaving(task_json: str) -> dict[str, bytes]:
    os._exit(3)


@pytest.mark.slow
@rendered
def test_a_frame_that_ends_all_its_workers_is_named(set_request: SetRequest, tmp_path: Path) -> None:
    run = partial(yield_frames, partial(run_local, workers=1, work=leaving))
    with pytest.raises(InputError, match=r"frame frames/0000\.jpg: 3 workers died of it, the last with exit code 3"):
        render_set(set_request, tmp_path / "set", run=run)


@pytest.mark.slow
@rendered
def test_a_cluster_renders_the_same_bytes_whatever_becomes_of_a_worker(
    cluster: tuple[str, list[subprocess.Popen[bytes]]], set_request: SetRequest, finished_set: Path, tmp_path: Path
) -> None:
    address, (_, first, _) = cluster

    def with_a_kill(tasks: Sequence[str]) -> Iterator[tuple[int, dict[str, bytes]]]:
        for number, (task, files) in enumerate(on_cluster(address)(tasks)):
            if number == 0:
                first.send_signal(signal.SIGKILL)
            yield task, files

    render_set(set_request, tmp_path / "set", run=with_a_kill)
    assert first.wait(timeout=10) == -signal.SIGKILL
    assert contents(tmp_path / "set") == contents(finished_set)


def test_frames_are_passed_on_as_they_are_finished() -> None:
    finished = [(1, {"b": b"2"}), (0, {"a": b"1"})]
    assert list(yield_frames(lambda tasks: iter(finished), ["", ""])) == finished


def test_a_scene_gets_its_overview(small_layout: Layout, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[TabletopRequest, Path]] = []
    monkeypatch.setattr(rendering, "render_tabletop", lambda request, out, progress: asked.append((request, out)))
    monkeypatch.setattr(rendering, "overview", lambda folder: np.full((40, 60, 3), 90, np.uint8))
    request = TabletopRequest(layout=small_layout)
    write_scene(request, tmp_path)
    assert asked == [(request, tmp_path)]
    assert read_image(tmp_path / "truth" / "overview.jpg").shape == (40, 60, 3)


@pytest.mark.parametrize(
    ("altered", "lost", "unfinished", "passed"),
    [((), (), (), True), (("a",), (), (), False), ((), ("a",), (), False), ((), (), ("a",), False)],
)
def test_any_file_that_is_not_right_fails_the_check(
    altered: tuple[str, ...], lost: tuple[str, ...], unfinished: tuple[str, ...], passed: bool
) -> None:
    assert SetCheck(3, altered, lost, unfinished).passed == passed


@pytest.mark.parametrize("name", ["../secret", "/secret", "link/secret"])
def test_no_file_outside_of_the_set_is_read(name: str, tmp_path: Path) -> None:
    folder = tmp_path / "set"
    folder.mkdir()
    (tmp_path / "secret").write_text("theirs")
    (folder / "link").symlink_to(tmp_path)
    name = str(tmp_path / "secret") if name == "/secret" else name
    dataset_of_two_frames().replaced(files={name: file_digest(tmp_path / "secret")}).save(folder)
    with pytest.raises(InputError, match=r"set: lists .*, expected the name of a file in this folder"):
        check_set(folder)


pytest.importorskip("OpenEXR", reason="rendering needs the extra render")
LINEAR = 60  # of 255, in the frame and in the view
MIDDLE_PX = (HEIGHT_PX - GAP_PX) // 2


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A set of uniform pictures; the left half of its central view is at 300 mm, the right one at 600 mm."""
    scene = scene_of_two_depths()
    sensor = SENSORS["ideal"].replaced(jpeg_quality=None)
    scene.replaced(width_px=96, height_px=54, sensor=sensor, central_view=(1, 0)).save(tmp_path)
    write_image(tmp_path / "frames/0000.png", np.full((54, 96, 3), LINEAR, np.uint8))
    write_image(tmp_path / "truth/views/1_0.png", np.full((30, 40, 3), LINEAR, np.uint8))
    depth_mm = np.full((30, 40), 300.0)
    depth_mm[:, 20:] = 600.0
    write_bytes(tmp_path / "truth/depth/1_0.exr", exr_bytes({"depth": depth_mm}, {}))
    return tmp_path


def test_pictures_are_brightened_and_near_is_red_far_is_blue(folder: Path) -> None:
    picture = overview(folder).astype(int)
    frame_px, view_px = round(HEIGHT_PX * 96 / 54), round(MIDDLE_PX * 40 / 30)
    assert abs(picture.shape[1] - (frame_px + GAP_PX + view_px)) <= 1
    assert picture.shape[0] == HEIGHT_PX
    bright = round(255.0 * (LINEAR / 255.0) ** (1.0 / 2.2))
    assert (picture[:, :frame_px] == bright).all()
    assert (picture[:MIDDLE_PX, frame_px + GAP_PX :] == bright).all()
    assert (picture[:, frame_px : frame_px + GAP_PX] == 255).all()
    assert (picture[MIDDLE_PX:-MIDDLE_PX, frame_px:] == 255).all()
    near, far = picture[-20, frame_px + GAP_PX + 20], picture[-20, -20]
    assert near[0] > near[2] + 40
    assert far[2] > far[0]


def test_a_view_at_one_depth_has_one_colour(folder: Path) -> None:
    write_bytes(folder / "truth/depth/1_0.exr", exr_bytes({"depth": np.full((30, 40), 400.0)}, {}))
    nearness = overview(folder)[-MIDDLE_PX:, -100:]
    assert (nearness == nearness[0, 0]).all()


def test_a_set_without_its_depth_is_refused_in_one_line(folder: Path) -> None:
    (folder / "truth/depth/1_0.exr").unlink()
    with pytest.raises(InputError, match=r"1_0\.exr: no such file$"):
        overview(folder)
