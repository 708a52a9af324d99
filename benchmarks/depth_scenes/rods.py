"""Rods and wires, 1 to 4 px wide in views of 400 px, upright, lying and leaning, before walls at several depths."""

from __future__ import annotations

import numpy as np

from benchmarks.depth_scenes.patterns import bricks, plaster, stone, weave
from benchmarks.depth_scenes.rendered_scene import FOCAL_IN_WIDTHS, Finish, Item, Lamp, Scene
from benchmarks.depth_scenes.surfaces import block, sheet, tube

_EYE_MM = 700.0
_WIDTHS_PX = (1.0, 1.3, 1.6, 2.0, 2.4, 2.8, 3.2, 3.6, 4.0) * 2
_TONES = ((0.08, 0.08, 0.09), (0.55, 0.50, 0.42), (0.30, 0.12, 0.08), (0.12, 0.20, 0.34))


def rods(seed: int) -> Scene:
    """Return the scene; the seed determines places, leans, tones and textures."""
    random = np.random.default_rng(seed)
    seeds = iter(random.integers(0, 2**31, 12).tolist())
    items = [
        Item(
            "wall",
            sheet((-1500.0, 5500.0, -600.0), (3000.0, 300.0, 0.0), (0.0, 0.0, 2600.0)),
            Finish(pattern=bricks(next(seeds), (0.36, 0.26, 0.2), courses=16), tile_mm=1400.0),
        ),
        Item(
            "floor",
            sheet((-2000.0, 1500.0, 150.0), (4000.0, 0.0, 0.0), (0.0, 5000.0, 0.0)),
            Finish(pattern=stone(next(seeds), (0.4, 0.38, 0.33)), tile_mm=900.0),
        ),
        Item(
            "box",
            block((520.0, 300.0, 650.0), (random.uniform(150.0, 350.0), 4600.0, 150.0), random.uniform(-25.0, 25.0)),
            Finish(pattern=weave(next(seeds), (0.25, 0.32, 0.4)), tile_mm=600.0),
        ),
        Item(
            "panel",
            sheet((-620.0, 4900.0, 150.0), (420.0, -200.0, 0.0), (0.0, 0.0, 1100.0)),
            Finish(pattern=plaster(next(seeds), (0.45, 0.43, 0.38), 0.06), tile_mm=900.0),
        ),
    ]
    tones = [Finish(pattern=plaster(next(seeds), tone, 0.1), tile_mm=300.0) for tone in _TONES]
    for number, width_px in enumerate(_WIDTHS_PX):
        y = random.uniform(2700.0, 4300.0)
        reach = y / (2.0 * FOCAL_IN_WIDTHS)
        centre = np.array([random.uniform(-0.85, 0.85) * reach, y, _EYE_MM + random.uniform(-0.55, 0.75) * reach])
        # A third each near upright, near level, and leaning; some come towards the eye.
        angle = np.radians((90.0, 0.0, random.uniform(25.0, 155.0))[number % 3] + random.uniform(-7.0, 7.0))
        half = 0.45 * reach * np.array([np.cos(angle), random.uniform(-0.6, 0.6), np.sin(angle)])
        path = centre + np.linspace(-1.0, 1.0, 12)[:, None] * half
        radius = 0.5 * width_px * y / (FOCAL_IN_WIDTHS * 400.0)
        items.append(Item(f"rod {number}", tube(path, radius), tones[number % len(tones)]))
    lamps = (
        Lamp((-1500.0, 1800.0, 3600.0), (0.0, 4500.0, 500.0), (500.0, 500.0), (60.0, 56.0, 50.0)),
        Lamp((1600.0, 2500.0, 3000.0), (0.0, 5600.0, 700.0), (400.0, 400.0), (26.0, 26.0, 28.0)),
    )
    return Scene(tuple(items), lamps, (0.16, 0.17, 0.19), eye_mm=_EYE_MM, pitch_deg=0.0)
