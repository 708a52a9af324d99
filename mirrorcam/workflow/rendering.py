"""Rendered sets, scenes and pictures as files, by processes of this machine or the workers of a cluster."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from mirrorcam.console.progress import Advance
from mirrorcam.figures.tabletop_figure import overview
from mirrorcam.optics.base.files import encoded_image, write_bytes, write_image
from mirrorcam.optics.base.values import FloatArray, InputError, Shaped, Value
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.sets.dataset import Dataset
from mirrorcam.render_scenes.sets.frame_task import FrameTask, render_frame_in_turn, render_frame_on_one_core
from mirrorcam.render_scenes.sets.render_set import Run
from mirrorcam.render_scenes.tabletop.product_picture import product_picture
from mirrorcam.render_scenes.tabletop.tabletop_set import DeskRequest, render_desk
from mirrorcam.workflow.cluster import run_cluster
from mirrorcam.workflow.workers import Died, run_local

OVERVIEW = "truth/overview.jpg"
JPEG_QUALITY = 85
"""Of a picture of the device."""


class PosesFile(Value):
    """Poses of the board: rig_from_board (n, 4, 4) in mm, and how many of them a motion passes in a second."""

    poses: Annotated[FloatArray, Shaped((None, 4, 4))]
    poses_hz: float = Field(default=1.0, gt=0)

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not len(self.poses):
            raise ValueError("no pose, expected one or more")
        for number, pose in enumerate(self.poses):
            turn = pose[:3, :3]
            if not np.allclose(turn @ turn.T, np.eye(3), rtol=0.0, atol=1e-6) or np.linalg.det(turn) < 0.0:
                raise ValueError(f"pose {number} turns by a matrix that is no rotation")
            if tuple(pose[3]) != (0.0, 0.0, 0.0, 1.0):
                raise ValueError(f"pose {number} has the last row {pose[3].tolist()}, expected 0, 0, 0, 1")
        return self


def in_workers(workers: int) -> Run:
    """Render frames in a number of processes of this machine, each on one core."""
    return partial(finished_frames, partial(run_local, workers=workers, work=render_frame_on_one_core))


def on_cluster(address: str) -> Run:
    """Render frames on the workers of a Dask scheduler."""
    return partial(finished_frames, partial(run_cluster, address=address, work=render_frame_in_turn))


def finished_frames(
    run: Callable[[Sequence[str]], Iterator[tuple[int, dict[str, bytes] | Died]]], tasks: Sequence[str]
) -> Iterator[tuple[int, dict[str, bytes]]]:
    """Number and files of each frame as `run` finishes them; raises InputError for one that ended all of its workers."""
    for number, got in run(tasks):
        if isinstance(got, Died):
            raise InputError(f"frame {FrameTask.model_validate_json(tasks[number]).name}: {got.reason}")
        yield number, got


@dataclass(frozen=True)
class SetCheck:
    """Files of a set against their checksums: those that differ or have gone, and those not rendered yet."""

    files: int
    altered: tuple[str, ...]
    lost: tuple[str, ...]
    unfinished: tuple[str, ...]

    @property
    def passed(self) -> bool:
        return not (self.altered or self.lost or self.unfinished)


def check_set(folder: Path) -> SetCheck:
    """Compare every file of a rendered set with its checksum."""
    dataset = Dataset.load(folder)
    wrong = [name for name in dataset.files if not dataset.intact(folder, name)]
    return SetCheck(
        files=len(dataset.files),
        altered=tuple(name for name in wrong if (folder / name).exists()),
        lost=tuple(name for name in wrong if not (folder / name).exists()),
        unfinished=tuple(dataset.missing),
    )


def write_scene(request: DeskRequest, folder: Path, advance: Advance = lambda done, total: None) -> None:
    """Render a photographed tabletop scene with its truth into a folder, and an overview of both."""
    render_desk(request, folder, on_picture=advance)
    write_image(folder / OVERVIEW, overview(folder))


def write_product_picture(layout: Layout, parts: Path, path: Path, *, spp: int = 64) -> None:
    """Render the device that `parts` holds of a layout, in `spp` samples a pixel, into a picture file."""
    picture = product_picture(layout, parts, spp=spp)
    write_bytes(path, encoded_image(picture, path.suffix.lower(), JPEG_QUALITY))
