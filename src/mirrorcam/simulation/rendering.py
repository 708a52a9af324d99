"""Render sets and scenes into files, with processes on this machine or the workers of a cluster."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.disk.output_folder import output_folder
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import read_image, write_image
from mirrorcam.core.processes.cluster import run_cluster
from mirrorcam.core.processes.worker_pool import Died, run_local
from mirrorcam.core.progress import Progress, no_progress
from mirrorcam.render_scenes.sets.dataset import Dataset
from mirrorcam.render_scenes.sets.frame_task import FrameTask, render_frame_in_turn, render_frame_on_one_core
from mirrorcam.render_scenes.sets.render_set import RenderTasks
from mirrorcam.render_scenes.tabletop.tabletop_set import TabletopRequest, TabletopSet, read_map, render_tabletop

OVERVIEW = "truth/overview.jpg"


def in_workers(workers: int) -> RenderTasks:
    """Render frames in a number of processes on this machine, each on one core."""
    return partial(yield_frames, partial(run_local, workers=workers, work=render_frame_on_one_core))


def on_cluster(address: str) -> RenderTasks:
    """Render frames on the workers of a Dask scheduler."""
    return partial(yield_frames, partial(run_cluster, address=address, work=render_frame_in_turn))


def yield_frames(
    run: Callable[[Sequence[str]], Iterator[tuple[int, dict[str, bytes] | Died]]], tasks: Sequence[str]
) -> Iterator[tuple[int, dict[str, bytes]]]:
    """Yield the index and files of each frame as `run` finishes it.

    Raises InputError for a frame that crashed every worker that tried it.
    """
    for number, files in run(tasks):
        if isinstance(files, Died):
            raise InputError(f"frame {FrameTask.model_validate_json(tasks[number]).name}: {files.reason}")
        yield number, files


def write_scene(request: TabletopRequest, folder: Path, progress: Progress = no_progress) -> None:
    """Render a tabletop scene with its ground truth into a folder, and an overview of both.

    Raises InputError if a file to be replaced does not belong to the scene, or was changed since.
    """
    with output_folder(folder, "scene") as output:
        output.refuse_others(OVERVIEW)
        render_tabletop(request, folder, progress=progress)
        with output.staged(complete=False) as staged:
            write_image(staged / OVERVIEW, overview(folder))


@dataclass(frozen=True)
class SetCheck:
    """Comparison of a set with its checksums: number of files; names of altered, missing and not yet rendered ones."""

    files: int
    altered: tuple[str, ...]
    missing: tuple[str, ...]
    unfinished: tuple[str, ...]

    @property
    def passed(self) -> bool:
        return not (self.altered or self.missing or self.unfinished)


def check_set(folder: Path) -> SetCheck:
    """Compare every file of a rendered set with its checksum."""
    dataset = Dataset.load(folder)
    damaged = [name for name in dataset.files if not dataset.intact(folder, name)]
    return SetCheck(
        files=len(dataset.files),
        altered=tuple(name for name in damaged if (folder / name).exists()),
        missing=tuple(name for name in damaged if not (folder / name).exists()),
        unfinished=tuple(dataset.missing),
    )


HEIGHT_PX = 480
GAP_PX = 10


def overview(folder: Path) -> NDArray[np.uint8]:
    """Draw the overview of a tabletop set.

    Parameters
    ----------
    folder
        Folder of the set.

    Returns
    -------
    array (h, w, 3)
        The frame at the left; at the right the true central view above its inverse depth, red where near. The view,
        and the frame of a sensor with a linear response, are gamma-encoded.

    Raises
    ------
    InputError
        If a file of the set is missing or cannot be read.
    """
    manifest = TabletopSet.load(folder)
    t, s = manifest.central_view
    frame = read_image(folder / manifest.frame_name)
    if manifest.sensor.tone_curve == "linear":
        frame = _gamma_encoded(frame)
    view = _gamma_encoded(read_image(folder / f"truth/views/{t}_{s}.png"))
    inverse_depth = 1.0 / read_map(folder / f"truth/depth/{t}_{s}.exr", "depth")
    low, high = float(inverse_depth.min()), float(inverse_depth.max())
    grey = np.rint(255.0 * (inverse_depth - low) / max(high - low, 1e-12)).astype(np.uint8)
    depth_picture = np.asarray(cv2.applyColorMap(grey, cv2.COLORMAP_TURBO))[..., ::-1]
    height, width = (HEIGHT_PX - GAP_PX) // 2, round((HEIGHT_PX - GAP_PX) / 2 * view.shape[1] / view.shape[0])
    small = [np.asarray(cv2.resize(image, (width, height))) for image in (view, depth_picture)]
    frame_width = round(HEIGHT_PX * frame.shape[1] / frame.shape[0])
    large = np.asarray(cv2.resize(frame, (frame_width, HEIGHT_PX), interpolation=cv2.INTER_AREA))
    picture = np.full((HEIGHT_PX, frame_width + GAP_PX + width, 3), 255, dtype=np.uint8)
    right = slice(frame_width + GAP_PX, None)
    picture[:, :frame_width], picture[:height, right], picture[-height:, right] = large, *small
    return picture


def _gamma_encoded(linear: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.rint(255.0 * (linear / 255.0) ** (1.0 / 2.2)).astype(np.uint8)
