"""Bushes, grass and hanging twigs at several depths in front of a brick wall, which is visible through their gaps."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchmarks.depth_scenes.patterns import bricks, plaster, stone
from benchmarks.depth_scenes.patterns import foliage as skin
from benchmarks.depth_scenes.rendered_scene import Finish, Item, Lamp, Scene
from benchmarks.depth_scenes.surfaces import Surface, joined, leaf, sheet, tube
from mirrorcam.core.values import FloatArray

_GREENS = ((0.16, 0.30, 0.07), (0.28, 0.38, 0.10), (0.10, 0.22, 0.08), (0.40, 0.33, 0.10))
# Foot or suspension (x, y, z) and top of plants, how far their twigs spread, how many twigs, leaves on each.
_BUSHES = (
    *(((-330.0, 2950.0, 0.0), 620.0, 260.0, 8, 12), ((300.0, 3500.0, 0.0), 900.0, 340.0, 10, 15)),
    *(((-420.0, 4600.0, 0.0), 1150.0, 420.0, 12, 16), ((560.0, 5600.0, 0.0), 1000.0, 520.0, 14, 18)),
    *(((-900.0, 6300.0, 0.0), 900.0, 480.0, 12, 16), ((120.0, 2900.0, 1200.0), -420.0, 330.0, 8, 10)),
)
_TUFTS = ((20.0, 2750.0), (-140.0, 3400.0), (430.0, 2850.0), (60.0, 4200.0), (-700.0, 5200.0), (900.0, 6600.0))


def _axes(random: np.random.Generator, direction: FloatArray) -> FloatArray:
    """Return the axes (3, 3) of a leaf that points in a direction, with a random rotation about it."""
    forward = direction / np.linalg.norm(direction)
    sideways = np.cross(forward, random.standard_normal(3))
    sideways /= np.linalg.norm(sideways)
    return np.stack([forward, sideways, np.cross(forward, sideways)])


def _bush(
    random: np.random.Generator, foot: FloatArray, height: float, spread: float, twigs: int, leaf_count: int
) -> Iterator[tuple[bool, Surface]]:
    """Yield the surfaces of a bush, with False for a twig and True for a leaf."""
    for _ in range(twigs):
        tip = np.add(foot, [*random.uniform(-spread, spread, 2), height * random.uniform(0.55, 1.0)])
        fraction = np.linspace(0.0, 1.0, 14)[:, None]
        path = foot + fraction * (tip - foot) + 0.14 * height * np.sin(np.pi * fraction) * random.uniform(-1.0, 1.0, 3)
        yield False, tube(path, random.uniform(1.5, 4.0))
        for position in random.uniform(0.2, 1.0, leaf_count):
            start = path[int(position * 13)]
            direction = np.add(random.uniform(-1.0, 1.0, 3), [0.0, 0.0, 0.3])
            length = random.uniform(55.0, 130.0)
            width, bend = length * random.uniform(0.16, 0.42), random.uniform(-0.2, 0.5)
            yield True, leaf(start, _axes(random, direction), length, width, bend, random.uniform(0.0, 400.0, 2))


def _tuft(random: np.random.Generator, foot: FloatArray) -> Iterator[Surface]:
    for _ in range(26):
        direction = np.array([*random.uniform(-0.45, 0.45, 2), 1.0])
        length, width = random.uniform(160.0, 420.0), random.uniform(5.0, 11.0)
        start = np.add(foot, [*random.uniform(-60.0, 60.0, 2), 0.0])
        yield leaf(
            start, _axes(random, direction), length, width, random.uniform(-0.4, 0.4), random.uniform(0.0, 400.0, 2)
        )


def foliage(seed: int) -> Scene:
    """The garden; plants and textures by the seed."""
    random = np.random.default_rng(seed)
    seeds = iter(random.integers(0, 2**31, 8).tolist())
    leaves: list[list[Surface]] = [[] for _ in _GREENS]
    twigs: list[Surface] = []
    for number, (foot, height, spread, twig_count, leaf_count) in enumerate(_BUSHES):
        for is_leaf, surface in _bush(random, np.array(foot), height, spread, twig_count, leaf_count):
            (leaves[number % len(_GREENS)] if is_leaf else twigs).append(surface)
    for number, (x, y) in enumerate(_TUFTS):
        leaves[(number + 1) % len(_GREENS)] += _tuft(random, np.array([x, y, 0.0]))
    wall = sheet((-2600.0, 7300.0, -100.0), (5600.0, 700.0, 0.0), (0.0, 0.0, 3600.0))
    ground = sheet((-3000.0, 1500.0, 0.0), (6500.0, 0.0, 0.0), (0.0, 7000.0, 0.0))
    items = (
        Item("wall", wall, Finish(pattern=bricks(next(seeds), (0.36, 0.19, 0.13), courses=16), tile_mm=1900.0)),
        Item("ground", ground, Finish(pattern=stone(next(seeds), (0.24, 0.21, 0.15)), tile_mm=1300.0)),
        Item("twigs", joined(twigs), Finish(pattern=plaster(next(seeds), (0.17, 0.11, 0.07), 0.2), tile_mm=300.0)),
        *(
            Item(f"leaves {number}", joined(surfaces), Finish(pattern=skin(next(seeds), colour), tile_mm=500.0))
            for number, (surfaces, colour) in enumerate(zip(leaves, _GREENS, strict=True))
        ),
    )
    lamps = (
        Lamp((-1800.0, 2000.0, 3800.0), (0.0, 5000.0, 300.0), (500.0, 500.0), (66.0, 60.0, 50.0)),
        Lamp((1500.0, 4500.0, 3600.0), (0.0, 7200.0, 600.0), (400.0, 400.0), (22.0, 22.0, 24.0)),
    )
    return Scene(items, lamps, (0.16, 0.19, 0.24), eye_mm=700.0, pitch_deg=3.0)
