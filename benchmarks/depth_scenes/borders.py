"""Large things close to the camera that every side of the picture cuts, before walls that reach out of it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchmarks.depth_scenes.patterns import Pattern, planks, plaster, repeated, stone, weave
from benchmarks.depth_scenes.rendered_scene import Finish, Item, Lamp, Scene
from benchmarks.depth_scenes.surfaces import ball, block, sheet, turned
from mirrorcam.core.values import FloatArray
from mirrorcam.render_scenes.tabletop.objects import texture

_SHADE = ((120.0, 0.0), (235.0, 0.0), (130.0, 300.0), (60.0, 330.0), (10.0, 340.0))
_CUP = ((0.0, 0.0), (42.0, 0.0), (48.0, 10.0), (52.0, 105.0), (47.0, 105.0), (42.0, 15.0), (0.0, 12.0))


def _room(seeds: Iterator[int], poster: Pattern) -> Iterator[Item]:
    up = (0.0, 0.0, 3600.0)
    yield Item(
        "floor",
        sheet((-3500.0, 1500.0, 0.0), (7000.0, 0.0, 0.0), (0.0, 7500.0, 0.0)),
        Finish(pattern=planks(next(seeds), (0.36, 0.27, 0.19), boards=6), tile_mm=1200.0),
    )
    yield Item(
        "end wall",
        sheet((-3000.0, 7600.0, 0.0), (6500.0, -300.0, 0.0), up),
        Finish(pattern=plaster(next(seeds), (0.40, 0.42, 0.45), 0.12), tile_mm=1600.0),
    )
    yield Item(
        "side wall",
        sheet((1300.0, 2500.0, 0.0), (-260.0, 5400.0, 0.0), up),
        Finish(pattern=weave(next(seeds), (0.45, 0.36, 0.28), threads=48), tile_mm=1400.0),
    )
    yield Item(
        "picture",
        sheet((-1300.0, 7480.0, 700.0), (1150.0, -53.0, 0.0), (0.0, 0.0, 1500.0)),
        Finish(pattern=poster, tile_mm=1500.0),
    )


def _cut(seeds: Iterator[int], shift: FloatArray) -> Iterator[Item]:
    """What the sides of the picture cut."""
    column = [(0.0, 0.0), (215.0, 0.0), (200.0, 80.0), (200.0, 1900.0), (0.0, 1900.0)]
    yield Item(
        "crate",
        block((560.0, 520.0, 1050.0), (-640.0 + shift[0, 0], 3050.0 + shift[0, 1], 0.0), 24.0),
        Finish(pattern=planks(next(seeds), (0.42, 0.30, 0.18), boards=5), tile_mm=700.0),
    )
    yield Item(
        "column",
        turned(column, (575.0 + shift[1, 0], 3050.0 + shift[1, 1], 0.0)),
        Finish(pattern=stone(next(seeds), (0.42, 0.41, 0.39), contrast=0.12), tile_mm=800.0),
    )
    yield Item(
        "shade",
        turned(_SHADE, (-30.0 + shift[2, 0], 2980.0 + shift[2, 1], 1080.0)),
        Finish(pattern=weave(next(seeds), (0.48, 0.42, 0.30), threads=80), tile_mm=400.0),
    )
    yield Item(
        "table",
        block((1000.0, 460.0, 330.0), (60.0 + shift[3, 0], 3050.0, 0.0), -5.0),
        Finish(pattern=plaster(next(seeds), (0.32, 0.34, 0.30), 0.08), tile_mm=900.0),
    )


def _whole(seeds: Iterator[int], shift_mm: float, cover: Pattern, page: Pattern) -> Iterator[Item]:
    """What stands on the table and behind it."""
    yield Item(
        "book",
        block((230.0, 170.0, 34.0), (-140.0, 2980.0 + shift_mm, 330.0), 21.0),
        Finish(pattern=cover, tile_mm=320.0),
    )
    yield Item(
        "cup",
        turned(_CUP, (130.0, 2950.0, 330.0)),
        Finish("satin", plaster(next(seeds), (0.55, 0.55, 0.5), 0.1), 200.0),
    )
    yield Item(
        "paper",
        sheet((230.0, 2840.0, 332.0), (150.0, 40.0, 0.0), (-56.0, 210.0, 0.0)),
        Finish(pattern=page, tile_mm=220.0),
    )
    yield Item(
        "globe",
        ball(230.0, (-150.0, 4700.0, 230.0)),
        Finish(pattern=repeated(texture("globe", (1024, 512), next(seeds))), tile_mm=725.0),
    )
    yield Item(
        "chest",
        block((700.0, 450.0, 520.0), (420.0, 5600.0, 0.0), 15.0),
        Finish(pattern=planks(next(seeds), (0.25, 0.17, 0.11), boards=4), tile_mm=600.0),
    )


def borders(seed: int) -> Scene:
    """The scene; textures and small shifts by the seed."""
    random = np.random.default_rng(seed)
    seeds = iter(random.integers(0, 2**31, 16).tolist())
    shift = random.uniform(-25.0, 25.0, (5, 2))
    poster, cover, page = (repeated(texture(name, (1024, 1024), next(seeds))) for name in ("poster", "cover", "page"))
    items = (*_room(seeds, poster), *_cut(seeds, shift), *_whole(seeds, shift[4, 0], cover, page))
    lamps = (
        Lamp((-900.0, 1500.0, 2600.0), (0.0, 3600.0, 300.0), (450.0, 450.0), (22.0, 20.5, 18.0)),
        Lamp((300.0, 5000.0, 3300.0), (0.0, 6500.0, 0.0), (450.0, 450.0), (24.0, 24.0, 25.0)),
    )
    return Scene(items, lamps, (0.12, 0.13, 0.16), eye_mm=900.0, pitch_deg=4.0)
