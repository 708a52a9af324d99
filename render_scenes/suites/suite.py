"""Suites: named, versioned lists of recipes, of the program or in a user's TOML file, and what their sets cost.

Processor time and bytes are predicted from rates that were measured. `python -m benchmarks.suite_scale rates` compares
them with what sets take. The rates are of one core of a machine that does `yardstick` in `YARDSTICK_S`; another
machine, or one that is busy with other work, is as much slower at both.
"""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import cv2
import numpy as np
from pydantic import Field, model_validator

from mirrorcam.core.bounds import PICTURES, Bounds
from mirrorcam.core.disk.files import LARGEST_TEXT_BYTES, inside, model_from, read_bytes, tables_of
from mirrorcam.core.errors import InputError
from mirrorcam.core.messages import shortened
from mirrorcam.core.names import Line
from mirrorcam.core.values import Value, with_tuples
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.settings import SensorModel
from mirrorcam.render_scenes.suites.recipe import SetRecipe, Slug

SUITES = Path(__file__).parent
VERSION = Bounds(1, 1_000_000)


class Suite(Value):
    """A suite: what its file states, `[defaults]` put into each `[[set]]` that does not state the same.

    Parameters
    ----------
    name
        Its name, which its results carry.
    version
        Number that is raised when its sets change, so that figures of one version compare.
    description
        What it is for.
    recipes
        Its sets, each or many of a kind as one recipe; in a file `[[set]]`.
    """

    name: Slug
    version: int = VERSION.field()
    description: Line = ""
    recipes: tuple[SetRecipe, ...] = Field(alias="set", min_length=1)

    @model_validator(mode="before")
    @classmethod
    def _with_defaults(cls, data: Any) -> Any:
        if not isinstance(data, dict) or not isinstance(data.get("set"), list | tuple):
            return data
        defaults = data.get("defaults", {})
        if not isinstance(defaults, dict) or "name" in defaults:
            raise ValueError("defaults: expected a table without a name")
        sets = [defaults | each if isinstance(each, dict) else each for each in data["set"]]
        others = {name: value for name, value in data.items() if name not in ("defaults", "set")}
        return others | {"set": with_tuples(sets)}

    @model_validator(mode="after")
    def _check(self) -> Self:
        count = sum(recipe.copies for recipe in self.recipes)
        if count > PICTURES.most:
            raise ValueError(f"{count} sets, expected {PICTURES.most} or fewer")
        names = [recipe.name for recipe in self.sets]
        if len(set(names)) < len(names):
            twice = next(name for number, name in enumerate(names) if name in names[:number])
            raise ValueError(f"set: the name {twice} appears twice")
        return self

    def times(self, copies: int) -> Self:
        """The suite with so many copies of each set, which differ in their seeds alone; one is the suite itself."""
        if copies == 1:
            return self
        recipes = tuple(recipe.replaced(copies=recipe.copies * copies) for recipe in self.recipes)
        return self.replaced(name=f"{self.name}-x{copies}", recipes=recipes)

    @property
    def sets(self) -> tuple[SetRecipe, ...]:
        """A recipe for each set."""
        return tuple(one for recipe in self.recipes for one in recipe.expanded())


def suite_names() -> tuple[str, ...]:
    """Names of the suites that come with the program."""
    return tuple(sorted(path.stem for path in SUITES.glob("*.toml")))


def read_suite(name: str) -> Suite:
    """A suite of the program by its name, or the suite of a TOML file, whose layouts are files beside it.

    Raises InputError in one line for a name that is not known, and a file or a recipe that is not valid.
    """
    if name in suite_names():
        return _read(SUITES / f"{name}.toml")
    if not name.lower().endswith(".toml"):
        raise InputError(f"suite {shortened(name, 40)!r}: expected one of {', '.join(suite_names())}, or a .toml file")
    return _read(Path(name))


def _read(path: Path) -> Suite:
    tables = tables_of(path, read_bytes(path, LARGEST_TEXT_BYTES))
    sets = tables.get("set")
    for each in (tables.get("defaults"), *(sets if isinstance(sets, list) else ())):
        if isinstance(each, dict) and isinstance(each.get("layout"), str):
            layout = Layout.load(inside(path.parent, each["layout"]))
            each["layout"] = json.loads(layout.model_dump_json(by_alias=True))
    return model_from(Suite, path, tables)


YARDSTICK_S = 0.030
SET_S = 3.8
"""Seconds of a set besides its pictures: plan, truth and compiled kernels."""
PLAN_S = 0.0075
"""Seconds of a picture per mirror: its pose is chosen, and its corners are projected."""
FAST_S, SAMPLE_S, PROCESSING_S = 0.07, 0.025, 0.22
"""Seconds per megapixel: of the fast renderer, of a sample of the reference, of a webcam's processing."""
PLATE_S, BENT_TIMES = 0.55, 2.4
"""Seconds per megapixel that plates add to the fast renderer; times that bent mirrors take of a sample."""
MAPS_S, MAP_S = 4.8, 0.25
"""Seconds per megapixel: of tracing the rays of all maps of a set, and of each map."""
MIRROR_S = 0.2
"""Seconds of a design, per mirror."""
START_S = 4.0
"""Seconds until a worker has loaded its libraries."""
QUALITIES, JPEG_BYTES = (25.0, 70.0, 85.0, 95.0, 100.0), (0.05, 0.095, 0.24, 0.365, 0.8)
"""Bytes per pixel of a JPEG of a quality, through nine mirrors."""
PNG_BYTES, NOISE_BYTES, MAP_BYTES = 0.49, 0.3, 7.9
"""Bytes per pixel of a PNG, of its noise per grey level, and of the maps."""
BASE_SHARE = 0.45
"""Bytes of a picture by the bare camera, of one through nine mirrors."""
MIRROR_SHARE = (0.3, 0.12)
"""Bytes of a picture through few mirrors, of one through nine: a constant, and a share of each mirror."""
TRUTH_BYTES = 300_000


@dataclass(frozen=True)
class Cost:
    """Processor seconds of the machine of the rates, bytes on the disk, and pictures."""

    seconds: float
    stored_bytes: float
    pictures: int


def set_cost(recipe: SetRecipe) -> Cost:
    """The cost of rendering a set, without that of its design."""
    camera, sensor = recipe.camera, recipe.sensor
    px = camera.width_px * camera.height_px
    megapixels, finish = px / 1e6, recipe.finish
    plates = recipe.design.is_second_surface if recipe.layout is None else recipe.layout.mirrors[0].is_second_surface
    bent = finish.sag_mm > 0.0 or finish.ripple_mm > 0.0
    if recipe.renderer == "mitsuba":
        base_s = frame_s = SAMPLE_S * recipe.spp
        frame_s *= BENT_TIMES if bent else 1.0
    else:
        base_s, frame_s = FAST_S, FAST_S + PLATE_S * plates
    more_s = MAP_S * recipe.maps + (PROCESSING_S if sensor.bayer or sensor.denoising_grey > 0.0 else 0.0)
    rendering_s = recipe.frames * (frame_s + more_s) + recipe.base_frames * (base_s + more_s) + MAPS_S * recipe.maps
    seconds = SET_S + PLAN_S * recipe.mirrors * recipe.pictures + megapixels * rendering_s
    covered = min(1.0, MIRROR_SHARE[0] + MIRROR_SHARE[1] * recipe.mirrors)
    shown = covered * recipe.frames + BASE_SHARE * recipe.base_frames
    stored = TRUTH_BYTES + px * (_picture_bytes(sensor) * shown + MAP_BYTES * recipe.maps * recipe.pictures)
    return Cost(seconds, stored, recipe.pictures)


def design_seconds(spec: DesignSpec) -> float:
    """Processor seconds of solving a design."""
    return MIRROR_S * len(spec.arrangement.steps)


def _picture_bytes(sensor: SensorModel) -> float:
    """Bytes per pixel of a picture through the mirrors."""
    if sensor.jpeg_quality is not None:
        return float(np.interp(sensor.jpeg_quality, QUALITIES, JPEG_BYTES))
    return PNG_BYTES + NOISE_BYTES * min(sensor.read_noise_grey, 2.0)


def elapsed_s(seconds: Sequence[float], workers: int, slowness: float) -> float:
    """Time until workers, each on a core of its own, have done work of these processor seconds.

    `slowness` is the ratio of this machine's time to the time on the machine of the rates.
    """
    if not seconds:
        return 0.0
    busy = min(workers, len(seconds))
    return slowness * (START_S + max(*seconds, sum(seconds) / busy))


def slowness() -> float:
    """How much longer a core of this machine takes than one of the machine of the rates; measured within a second."""
    return min(yardstick() for _ in range(3)) / YARDSTICK_S


def yardstick() -> float:
    """Processor seconds of a fixed piece of work on one core."""
    numbers = np.random.default_rng(0).random((1080, 1920))
    started = time.process_time()
    grey = (255.0 * np.exp(-numbers)).astype(np.uint8)
    for _ in range(4):
        cv2.imencode(".jpg", grey)
    return time.process_time() - started
