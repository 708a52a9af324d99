"""A long room at a grazing angle: slanted floor, walls and ramp of weak texture, and light that falls off."""

from __future__ import annotations

import numpy as np

from benchmarks.depth_scenes.patterns import plaster
from benchmarks.depth_scenes.rendered_scene import Finish, Item, Lamp, Scene
from benchmarks.depth_scenes.surfaces import ball, block, revolved, sheet

_COLUMN = ((0.0, 0.0), (150.0, 0.0), (150.0, 60.0), (110.0, 90.0), (100.0, 700.0), (150.0, 760.0), (0.0, 760.0))


def slant(seed: int) -> Scene:
    """Return the scene; the seed determines textures and small shifts."""
    random = np.random.default_rng(seed)
    seeds = iter(random.integers(0, 2**31, 8).tolist())
    shift = random.uniform(-40.0, 40.0, 4)

    def plain(red: float, green: float, blue: float, contrast: float, tile_mm: float = 1500.0) -> Finish:
        return Finish(pattern=plaster(next(seeds), (red, green, blue), contrast), tile_mm=tile_mm)

    up = (0.0, 0.0, 2200.0)
    items = (
        Item(
            "floor",
            sheet((-2500.0, 1500.0, 0.0), (5500.0, 0.0, 0.0), (0.0, 8000.0, 0.0)),
            plain(0.36, 0.33, 0.3, 0.045),
        ),
        Item("left wall", sheet((-430.0, 2000.0, 0.0), (-520.0, 7000.0, 0.0), up), plain(0.42, 0.42, 0.45, 0.04)),
        Item("right wall", sheet((820.0, 2000.0, 0.0), (100.0, 7000.0, 0.0), up), plain(0.46, 0.4, 0.34, 0.045)),
        Item("end wall", sheet((-2200.0, 8150.0, 0.0), (4800.0, 900.0, 0.0), up), plain(0.4, 0.4, 0.38, 0.05)),
        Item(
            "ramp",
            sheet((40.0 + shift[0], 3700.0, 0.0), (420.0, 90.0, 0.0), (30.0, 2100.0, 560.0)),
            plain(0.33, 0.36, 0.4, 0.04, 1100.0),
        ),
        Item("ball", ball(150.0, (-130.0 + shift[1], 3350.0, 150.0)), plain(0.5, 0.46, 0.4, 0.05, 900.0)),
        Item("column", revolved(_COLUMN, (-420.0 + shift[2], 6200.0, 0.0)), plain(0.45, 0.44, 0.42, 0.05, 900.0)),
        Item("step", block((420.0, 700.0, 130.0), (420.0 + shift[3], 3350.0, 0.0), 24.0), plain(0.4, 0.36, 0.36, 0.04)),
    )
    lamp = Lamp((250.0, 2300.0, 3100.0), (100.0, 4300.0, 0.0), (350.0, 350.0), (44.0, 40.0, 34.0))
    return Scene(items, (lamp,), (0.012, 0.014, 0.02), eye_mm=560.0, pitch_deg=2.0)
