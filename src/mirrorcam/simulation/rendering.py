"""Rendered sets, scenes and pictures as files, by processes of this machine or the workers of a cluster."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

from mirrorcam.core.disk.files import write_bytes
from mirrorcam.core.disk.output_folder import output_folder
from mirrorcam.core.images.pictures import encoded_image, write_image
from mirrorcam.core.processes.cluster import run_cluster
from mirrorcam.core.processes.worker_pool import Died, run_local
from mirrorcam.core.progress import Progress, no_progress
from mirrorcam.core.values import InputError
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.reference.product_picture import product_picture
from mirrorcam.render_scenes.sets.frame_task import FrameTask, render_frame_in_turn, render_frame_on_one_core
from mirrorcam.render_scenes.sets.render_set import Run
from mirrorcam.render_scenes.tabletop.tabletop_set import TabletopRequest, render_tabletop
from mirrorcam.simulation.tabletop_figure import overview

OVERVIEW = "truth/overview.jpg"
JPEG_QUALITY = 85
"""JPEG quality of a picture of the device."""


def in_workers(workers: int) -> Run:
    """Render frames in a number of processes of this machine, each on one core."""
    return partial(finished_frames, partial(run_local, workers=workers, work=render_frame_on_one_core))


def on_cluster(address: str) -> Run:
    """Render frames on the workers of a Dask scheduler."""
    return partial(finished_frames, partial(run_cluster, address=address, work=render_frame_in_turn))


def finished_frames(
    run: Callable[[Sequence[str]], Iterator[tuple[int, dict[str, bytes] | Died]]], tasks: Sequence[str]
) -> Iterator[tuple[int, dict[str, bytes]]]:
    """Yield number and files of each frame as `run` finishes it.

    Raises InputError for a frame that ended all of its workers.
    """
    for number, got in run(tasks):
        if isinstance(got, Died):
            raise InputError(f"frame {FrameTask.model_validate_json(tasks[number]).name}: {got.reason}")
        yield number, got


def write_scene(request: TabletopRequest, folder: Path, progress: Progress = no_progress) -> None:
    """Render a photographed tabletop scene with its truth into a folder, and an overview of both.

    Raises InputError where a file in their place is not of the scene, or was changed since.
    """
    with output_folder(folder, "scene") as output:
        output.refuse_others(OVERVIEW)
        render_tabletop(request, folder, progress=progress)
        with output.staged(complete=False) as staged:
            write_image(staged / OVERVIEW, overview(folder))


def write_product_picture(layout: Layout, parts: Path, path: Path, *, spp: int = 64) -> None:
    """Render the device that `parts` holds of a layout, in `spp` samples a pixel, into a picture file."""
    picture = product_picture(layout, parts, spp=spp)
    write_bytes(path, encoded_image(picture, path.suffix.lower(), JPEG_QUALITY))
