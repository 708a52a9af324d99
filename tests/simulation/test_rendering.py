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

from mirrorcam.core.images.pictures import read_image
from mirrorcam.core.processes.worker_pool import run_local
from mirrorcam.core.values import InputError
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.sets.render_set import render_set
from mirrorcam.render_scenes.sets.set_request import SetRequest
from mirrorcam.render_scenes.settings import RenderSettings
from mirrorcam.render_scenes.tabletop.tabletop_set import TabletopRequest
from mirrorcam.simulation import rendering
from mirrorcam.simulation.rendering import finished_frames, in_workers, on_cluster, write_product_picture, write_scene
from tests.small_set import contents

# Not by importing it: that would choose an LLVM.
rendered = pytest.mark.skipif(find_spec("mitsuba") is None, reason="rendering needs the extra render")


@rendered
@pytest.mark.parametrize("workers", [1, 2])
def test_the_bytes_do_not_depend_on_the_number_of_workers(
    workers: int, set_request: SetRequest, finished_set: Path, tmp_path: Path
) -> None:
    render_set(set_request, tmp_path / "set", run=in_workers(workers))
    assert contents(tmp_path / "set") == contents(finished_set)


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


@rendered
def test_a_frame_that_ends_all_its_workers_is_named(set_request: SetRequest, tmp_path: Path) -> None:
    run = partial(finished_frames, partial(run_local, workers=1, work=leaving))
    with pytest.raises(InputError, match=r"frame frames/0000\.jpg: 3 workers died of it, the last with exit code 3"):
        render_set(set_request, tmp_path / "set", run=run)


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
    assert list(finished_frames(lambda tasks: iter(finished), ["", ""])) == finished


def test_a_scene_gets_its_overview(small_layout: Layout, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[TabletopRequest, Path]] = []
    monkeypatch.setattr(rendering, "render_tabletop", lambda request, out, progress: asked.append((request, out)))
    monkeypatch.setattr(rendering, "overview", lambda folder: np.full((40, 60, 3), 90, np.uint8))
    request = TabletopRequest(layout=small_layout)
    write_scene(request, tmp_path)
    assert asked == [(request, tmp_path)]
    assert read_image(tmp_path / "truth" / "overview.jpg").shape == (40, 60, 3)


@pytest.mark.parametrize(("name", "error"), [("device.png", 0), ("device.JPG", 2)])
def test_a_picture_of_the_device_is_written_in_the_format_of_its_name(
    name: str, error: int, small_layout: Layout, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    picture = np.repeat(np.tile(np.arange(60, dtype=np.uint8), (40, 1))[..., None], 3, axis=2)
    asked: list[tuple[Path, int]] = []

    def drawn(layout: Layout, parts: Path, *, spp: int) -> np.ndarray:
        asked.append((parts, spp))
        return picture

    monkeypatch.setattr(rendering, "product_picture", drawn)
    write_product_picture(small_layout, tmp_path / "cad", tmp_path / name, spp=5)
    assert asked == [(tmp_path / "cad", 5)]
    assert np.abs(read_image(tmp_path / name).astype(int) - picture).max() <= error
    write_product_picture(small_layout, tmp_path / "cad", tmp_path / name.lower(), spp=5)
    assert (tmp_path / name).read_bytes() == (tmp_path / name.lower()).read_bytes()
