"""A shelf full of books, boxes, crates and wires, with dark compartments, and a room seen through and past it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchmarks.depth_scenes.patterns import bricks, planks, plaster, repeated, stone, weave
from benchmarks.depth_scenes.rendered_scene import Finish, Item, Lamp, Scene
from benchmarks.depth_scenes.surfaces import Surface, ball, block, joined, sheet, tube, turned
from mirrorcam.render_scenes.tabletop.objects import TextureName, texture

_FRONT_MM, _DEPTH_MM, _BOARD_MM = 3000.0, 320.0, 16.0
_UPRIGHTS = (-600.0, -190.0, 230.0)
_SHELVES = (0.0, 250.0, 500.0, 780.0, 1060.0, 1320.0)
_JAR = ((0.0, 0.0), (48.0, 0.0), (55.0, 20.0), (55.0, 110.0), (38.0, 135.0), (42.0, 150.0), (0.0, 150.0))
_PRINTS: tuple[TextureName, ...] = ("cover", "page", "poster", "label")
# What stands in each compartment, from the top row, left and right; boxes behind slats and in crates.
_FILLING = (("books", "crate"), ("boxes", "books"), ("slats", "jars"), ("books", "boxes"), ("boxes", "slats"))


def _shelf() -> Surface:
    middle, wide = (_UPRIGHTS[0] + _UPRIGHTS[-1]) / 2.0, _UPRIGHTS[-1] - _UPRIGHTS[0]
    at = _FRONT_MM + _DEPTH_MM / 2.0
    boards = [block((wide, _DEPTH_MM, _BOARD_MM), (middle, at, z)) for z in _SHELVES]
    sides = [block((_BOARD_MM, _DEPTH_MM + 4.0, _SHELVES[-1] + 40.0), (x, at, 0.0)) for x in _UPRIGHTS]
    return joined([*boards, *sides])


def _books(random: np.random.Generator, left: float, right: float, low: float, high: float) -> Iterator[Surface]:
    x = left + 12.0
    while x < right - 40.0:
        wide, deep = random.uniform(14.0, 40.0), random.uniform(130.0, 210.0)
        tall = (high - low) * random.uniform(0.6, 0.92)
        y = _FRONT_MM + 10.0 + random.uniform(0.0, 70.0) + deep / 2.0
        yield block((wide - 2.0, deep, tall), (x + wide / 2.0, y, low))
        x += wide + (random.uniform(20.0, 60.0) if random.random() < 0.12 else 0.0)


def _boxes(random: np.random.Generator, left: float, right: float, low: float, high: float) -> Iterator[Surface]:
    x = left + 20.0
    while x < right - 90.0:
        wide, tall = random.uniform(70.0, 130.0), (high - low) * random.uniform(0.25, 0.5)
        y = _FRONT_MM + 110.0 + random.uniform(0.0, 60.0)
        yield block((wide, 0.9 * wide, tall), (x + wide / 2.0, y, low), random.uniform(-20.0, 20.0))
        if random.random() < 0.6:
            above = (x + wide / 2.0 + random.uniform(-15.0, 15.0), y, low + tall)
            yield block((0.6 * wide, 0.6 * wide, 0.6 * tall), above, random.uniform(-40.0, 40.0))
        x += wide + random.uniform(5.0, 50.0)


def _slats(left: float, right: float, low: float, high: float) -> Iterator[Surface]:
    """A grille before a compartment."""
    for x in np.arange(left + 22.0, right - 15.0, 26.0):
        yield block((10.0, 6.0, high - low), (x, _FRONT_MM - 6.0, low))


def _crate(left: float, right: float, low: float) -> Iterator[Surface]:
    wide, deep = right - left - 90.0, 200.0
    middle, y = (left + right) / 2.0, _FRONT_MM + 140.0
    for z in (0.0, 45.0, 90.0):
        for across in (-deep / 2.0, deep / 2.0):
            yield block((wide, 8.0, 30.0), (middle, y + across, low + z))
        for across in (-wide / 2.0, wide / 2.0):
            yield block((8.0, deep, 30.0), (middle + across, y, low + z))


def _wires(random: np.random.Generator) -> Iterator[Surface]:
    part = np.linspace(0.0, 1.0, 40)[:, None]
    for height in (*(0.0,) * 6, *(1500.0,) * 4):
        start = np.array([random.uniform(-600.0, 600.0), random.uniform(2700.0, 2960.0), 1500.0])
        end = np.array([random.uniform(-600.0, 600.0), random.uniform(2750.0, 2960.0), height])
        sag = [*random.uniform(-150.0, 150.0, 2) * [1.0, 0.2], -random.uniform(0.2, 0.75) * height]
        yield tube(start + part * (end - start) + np.sin(np.pi * part) * sag, random.uniform(1.4, 3.5))


def _contents(random: np.random.Generator) -> dict[str, list[Surface]]:
    """Surfaces by the material that they have."""
    found: dict[str, list[Surface]] = {name: [] for name in (*_PRINTS, "slats", "jars")}
    for row, kinds in zip(range(len(_SHELVES) - 1)[::-1], _FILLING, strict=True):
        low, high = _SHELVES[row] + _BOARD_MM, _SHELVES[row + 1]
        for kind, left, right in zip(kinds, _UPRIGHTS, _UPRIGHTS[1:], strict=False):
            if kind in ("slats", "crate"):
                found["slats"] += _slats(left, right, low, high) if kind == "slats" else _crate(left, right, low)
            if kind == "jars":
                places = np.arange(left + 75.0, right, 115.0)
                found["jars"] += [turned(_JAR, (x, _FRONT_MM + 120.0, low)) for x in places]
            else:
                for surface in (_books if kind == "books" else _boxes)(random, left, right, low, high):
                    found[_PRINTS[random.integers(len(_PRINTS))]].append(surface)
    return found


def _filled(random: np.random.Generator, seeds: Iterator[int], contents: dict[str, list[Surface]]) -> Iterator[Item]:
    """The shelf with its contents, and wires before it."""
    pine = planks(next(seeds), (0.46, 0.33, 0.20), boards=5)
    yield Item("shelf", _shelf(), Finish(pattern=pine, tile_mm=700.0))
    yield Item(
        "back",
        sheet((_UPRIGHTS[0], _FRONT_MM + _DEPTH_MM, 0.0), (410.0, 0.0, 0.0), (0.0, 0.0, 1320.0)),
        Finish(pattern=pine, tile_mm=900.0),
    )
    for name in _PRINTS:
        pattern = repeated(texture(name, (1024, 1024), next(seeds)))
        yield Item(name, joined(contents[name]), Finish(pattern=pattern, tile_mm=330.0))
    yield Item(
        "slats",
        joined(contents["slats"]),
        Finish(pattern=planks(next(seeds), (0.40, 0.30, 0.20), boards=9), tile_mm=300.0),
    )
    yield Item("jars", joined(contents["jars"]), Finish("satin", stone(next(seeds), (0.38, 0.40, 0.34)), 300.0))
    yield Item(
        "wires", joined(list(_wires(random))), Finish("matte", plaster(next(seeds), (0.10, 0.10, 0.11), 0.3), 100.0)
    )


def _room(seeds: Iterator[int]) -> Iterator[Item]:
    up = (0.0, 0.0, 3600.0)
    yield Item(
        "floor",
        sheet((-3500.0, 1500.0, 0.0), (7000.0, 0.0, 0.0), (0.0, 7500.0, 0.0)),
        Finish(pattern=stone(next(seeds), (0.32, 0.31, 0.30), contrast=0.1), tile_mm=1500.0),
    )
    yield Item(
        "end wall",
        sheet((-3000.0, 6600.0, 0.0), (6500.0, 700.0, 0.0), up),
        Finish(pattern=bricks(next(seeds), (0.36, 0.30, 0.26), courses=14), tile_mm=1900.0),
    )
    yield Item(
        "side wall",
        sheet((900.0, 2500.0, 0.0), (180.0, 5200.0, 0.0), up),
        Finish(pattern=plaster(next(seeds), (0.40, 0.40, 0.42), 0.07), tile_mm=1500.0),
    )
    yield Item(
        "chest",
        block((420.0, 420.0, 480.0), (560.0, 4300.0, 0.0), 30.0),
        Finish(pattern=weave(next(seeds), (0.22, 0.30, 0.36)), tile_mm=500.0),
    )
    yield Item(
        "ball",
        ball(120.0, (470.0, 3500.0, 120.0)),
        Finish("satin", plaster(next(seeds), (0.5, 0.42, 0.16), 0.15), 400.0),
    )


def clutter(seed: int) -> Scene:
    """The shelf and the room; contents and textures by the seed."""
    random = np.random.default_rng(seed)
    seeds = iter(random.integers(0, 2**31, 16).tolist())
    contents = _contents(random)
    items = (*_filled(random, seeds, contents), *_room(seeds))
    lamps = (
        Lamp((-700.0, 1300.0, 2300.0), (-100.0, 3100.0, 600.0), (350.0, 350.0), (24.0, 22.0, 19.0)),
        Lamp((600.0, 4800.0, 3000.0), (500.0, 6000.0, 300.0), (350.0, 350.0), (20.0, 20.5, 22.0)),
    )
    return Scene(items, lamps, (0.06, 0.065, 0.08), eye_mm=740.0, pitch_deg=2.0)
