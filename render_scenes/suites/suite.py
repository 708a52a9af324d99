"""Suites: named, versioned lists of recipes, built in or in a user's TOML file, and the cost of their sets.

Processor time and bytes are predicted from measured rates. `python -m benchmarks.suite_scale rates` compares them with
the actual cost of sets. The rates hold for one core of a machine that runs `yardstick` in `YARDSTICK_S`. On a different
or busy machine, both are assumed to be slower by the same factor.
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
    """A suite as in its file, with `[defaults]` for the missing values of each `[[set]]`.

    Parameters
    ----------
    name
        Name of the suite, repeated in its results.
    version
        Number that changes whenever a set does, so that figures of the same version are comparable.
    description
        Purpose of the suite.
    recipes
        Recipes of the sets, each with one or more copies; `[[set]]` in a file.
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
        sets = [defaults | entry if isinstance(entry, dict) else entry for entry in data["set"]]
        others = {name: value for name, value in data.items() if name not in ("defaults", "set")}
        return others | {"set": with_tuples(sets)}

    @model_validator(mode="after")
    def _check(self) -> Self:
        count = sum(recipe.copies for recipe in self.recipes)
        if count > PICTURES.max:
            raise ValueError(f"{count} sets, expected {PICTURES.max} or fewer")
        names = [recipe.name for recipe in self.sets]
        if len(set(names)) < len(names):
            duplicate = next(name for number, name in enumerate(names) if name in names[:number])
            raise ValueError(f"set: the name {duplicate} appears twice")
        return self

    def times(self, copies: int) -> Self:
        """Return the suite with a number of copies of each set that differ only in their seeds."""
        if copies == 1:
            return self
        recipes = tuple(recipe.replaced(copies=recipe.copies * copies) for recipe in self.recipes)
        return self.replaced(name=f"{self.name}-x{copies}", recipes=recipes)

    @property
    def sets(self) -> tuple[SetRecipe, ...]:
        """One recipe per set."""
        return tuple(copy for recipe in self.recipes for copy in recipe.expanded())


def suite_names() -> tuple[str, ...]:
    """Return the names of the built-in suites."""
    return tuple(sorted(path.stem for path in SUITES.glob("*.toml")))


def read_suite(name: str) -> Suite:
    """Load a built-in suite by its name, or the suite of a TOML file, with paths of layouts relative to the file.

    Raises InputError for an unknown name, and for an invalid file or recipe.
    """
    if name in suite_names():
        return _read(SUITES / f"{name}.toml")
    if not name.lower().endswith(".toml"):
        raise InputError(f"suite {shortened(name, 40)!r}: expected one of {', '.join(suite_names())}, or a .toml file")
    return _read(Path(name))


def _read(path: Path) -> Suite:
    tables = tables_of(path, read_bytes(path, LARGEST_TEXT_BYTES))
    sets = tables.get("set")
    for table in (tables.get("defaults"), *(sets if isinstance(sets, list) else ())):
        if isinstance(table, dict) and isinstance(table.get("layout"), str):
            layout = Layout.load(inside(path.parent, table["layout"]))
            table["layout"] = json.loads(layout.model_dump_json(by_alias=True))
    return model_from(Suite, path, tables)


YARDSTICK_S = 0.030
SET_S = 3.8
"""Seconds per set besides its pictures: plan, ground truth and compilation of kernels."""
PLAN_S = 0.0075
"""Seconds per picture and mirror, for the choice of the pose and the projection of corners."""
FAST_S, SAMPLE_S, PROCESSING_S = 0.07, 0.025, 0.22
"""Seconds per megapixel: the fast renderer; one sample per pixel of the reference; a webcam's processing."""
PLATE_S, BENT_FACTOR = 0.55, 2.4
"""Additional seconds per megapixel for plates in the fast renderer; ratio of a sample's time with bent mirrors."""
MAPS_S, MAP_S = 4.8, 0.25
"""Seconds per megapixel: tracing the rays shared by all maps of a set; each map."""
MIRROR_S = 0.2
"""Seconds for solving a design, per mirror."""
START_S = 4.0
"""Seconds until a worker has loaded its libraries."""
QUALITIES, JPEG_BYTES = (25.0, 70.0, 85.0, 95.0, 100.0), (0.05, 0.095, 0.24, 0.365, 0.8)
"""JPEG qualities, and the bytes per pixel of a picture via nine mirrors at each."""
PNG_BYTES, NOISE_BYTES, MAP_BYTES = 0.49, 0.3, 7.9
"""Bytes per pixel of a PNG, of its noise per grey level, and of the maps."""
BASE_RATIO = 0.45
"""Bytes of a picture by the bare camera, relative to one via nine mirrors."""
MIRROR_RATIO = (0.3, 0.12)
"""Bytes of a picture via few mirrors, relative to one via nine: a constant, and a term per mirror."""
TRUTH_BYTES = 300_000


@dataclass(frozen=True)
class Cost:
    """Processor seconds on the machine of the rates, bytes on disk, and number of pictures."""

    seconds: float
    stored_bytes: float
    pictures: int


def set_cost(recipe: SetRecipe) -> Cost:
    """Return the cost of rendering a set, without its design."""
    camera, sensor = recipe.camera, recipe.sensor
    px = camera.width_px * camera.height_px
    megapixels, finish = px / 1e6, recipe.finish
    plates = recipe.design.is_second_surface if recipe.layout is None else recipe.layout.mirrors[0].is_second_surface
    bent = finish.sag_mm > 0.0 or finish.ripple_mm > 0.0
    if recipe.renderer == "mitsuba":
        base_s = frame_s = SAMPLE_S * recipe.spp
        frame_s *= BENT_FACTOR if bent else 1.0
    else:
        base_s, frame_s = FAST_S, FAST_S + PLATE_S * plates
    extra_s = MAP_S * recipe.maps + (PROCESSING_S if sensor.bayer or sensor.denoising_grey > 0.0 else 0.0)
    rendering_s = recipe.frames * (frame_s + extra_s) + recipe.base_frames * (base_s + extra_s) + MAPS_S * recipe.maps
    seconds = SET_S + PLAN_S * recipe.mirrors * recipe.pictures + megapixels * rendering_s
    covered = min(1.0, MIRROR_RATIO[0] + MIRROR_RATIO[1] * recipe.mirrors)
    equivalent_pictures = covered * recipe.frames + BASE_RATIO * recipe.base_frames
    stored = TRUTH_BYTES + px * (
        _picture_bytes(sensor) * equivalent_pictures + MAP_BYTES * recipe.maps * recipe.pictures
    )
    return Cost(seconds, stored, recipe.pictures)


def design_seconds(spec: DesignSpec) -> float:
    """Return the processor seconds of solving a design."""
    return MIRROR_S * len(spec.arrangement.steps)


def _picture_bytes(sensor: SensorModel) -> float:
    """Return the bytes per pixel of a picture via the mirrors."""
    if sensor.jpeg_quality is not None:
        return float(np.interp(sensor.jpeg_quality, QUALITIES, JPEG_BYTES))
    return PNG_BYTES + NOISE_BYTES * min(sensor.read_noise_grey, 2.0)


def elapsed_s(seconds: Sequence[float], workers: int, slowness: float) -> float:
    """Return the elapsed time of work with these processor seconds, for workers with one core each.

    `slowness` is the ratio of this machine's time to the time on the machine of the rates.
    """
    if not seconds:
        return 0.0
    used_workers = min(workers, len(seconds))
    return slowness * (START_S + max(*seconds, sum(seconds) / used_workers))


def slowness() -> float:
    """Measure, within a second, the ratio of a core's time here to the time on the machine of the rates."""
    return min(yardstick() for _ in range(3)) / YARDSTICK_S


def yardstick() -> float:
    """Return the processor seconds of a fixed piece of work on one core."""
    numbers = np.random.default_rng(0).random((1080, 1920))
    start_s = time.process_time()
    grey = (255.0 * np.exp(-numbers)).astype(np.uint8)
    for _ in range(4):
        cv2.imencode(".jpg", grey)
    return time.process_time() - start_s
