"""Glossy, metallic and mirror-like objects among matte ones on a polished table; the truth is the first surface."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchmarks.depth_scenes.patterns import Pattern, bricks, planks, plaster, resized, stone, weave
from benchmarks.depth_scenes.rendered_scene import Finish, Item, Lamp, Scene
from benchmarks.depth_scenes.surfaces import ball, block, revolved, sheet, tube
from mirrorcam.render_scenes.tabletop.objects import texture

# Radii and heights of what is turned.
# fmt: off
_VASE = ((0, 0), (75, 0), (95, 40), (135, 160), (90, 300), (45, 380), (70, 430), (0, 400))
_KETTLE = ((0, 0), (130, 0), (150, 50), (135, 150), (60, 200), (30, 215), (30, 240), (0, 250))
_BOWL = ((0, 0), (60, 0), (70, 15), (130, 60), (165, 120), (158, 120), (110, 60), (0, 30))
_POT = ((0, 0), (90, 0), (120, 200), (135, 205), (135, 245), (115, 245), (100, 200), (0, 190))
_CAN = ((0, 0), (60, 0), (62, 6), (62, 174), (60, 180), (0, 180))
# fmt: on


def _room(seeds: Iterator[int], wood: Pattern, poster: Pattern) -> Iterator[Item]:
    yield Item(
        "table",
        sheet((-1500.0, 1800.0, 0.0), (3000.0, 0.0, 0.0), (0.0, 3600.0, 0.0)),
        Finish("glossy", wood, 900.0),
    )
    yield Item(
        "floor",
        sheet((-4000.0, -1500.0, -750.0), (8000.0, 0.0, 0.0), (0.0, 9500.0, 0.0)),
        Finish("satin", stone(next(seeds), (0.3, 0.29, 0.27)), 1500.0),
    )
    yield Item(
        "wall",
        sheet((-3000.0, 7000.0, -750.0), (6500.0, 500.0, 0.0), (0.0, 0.0, 3800.0)),
        Finish("matte", plaster(next(seeds), (0.42, 0.40, 0.36), 0.1), 1500.0),
    )
    yield Item(
        "poster",
        sheet((-250.0, 7100.0, 300.0), (900.0, 65.0, 0.0), (0.0, 0.0, 900.0)),
        Finish("glossy", poster, 1000.0),
    )
    yield Item(
        "brick pillar",
        block((520.0, 400.0, 3000.0), (-1020.0, 6400.0, -750.0), 12.0),
        Finish("matte", bricks(next(seeds), (0.4, 0.22, 0.15)), 900.0),
    )


def _objects(random: np.random.Generator, seeds: Iterator[int], label: Pattern) -> Iterator[Item]:
    def position(x: float, y: float) -> tuple[float, float, float]:
        return x + random.uniform(-20.0, 20.0), y + random.uniform(-20.0, 20.0), 0.0

    handle = np.linspace(0.0, np.pi, 24)[:, None]
    kettle, marble = position(215.0, 3000.0), position(-60.0, 2930.0)
    arc = np.add(kettle, (0.0, 0.0, 170.0)) + np.cos(handle) * [120.0, 40.0, 0.0] + np.sin(handle) * [0.0, 0.0, 150.0]
    yield Item("vase", revolved(_VASE, position(-330.0, 3250.0)), Finish("mirror", colour=(0.88, 0.86, 0.82)))
    yield Item("kettle", revolved(_KETTLE, kettle), Finish("metal", colour=(0.85, 0.50, 0.34), roughness=0.18))
    yield Item("handle", tube(arc, 7.0, 12), Finish("satin", colour=(0.04, 0.04, 0.05)))
    yield Item(
        "marble",
        ball(95.0, (marble[0], marble[1], 95.0)),
        Finish("glossy", stone(next(seeds), (0.55, 0.5, 0.46)), 300.0),
    )
    yield Item(
        "bowl",
        revolved(_BOWL, position(430.0, 3700.0)),
        Finish("glossy", stone(next(seeds), (0.16, 0.28, 0.42)), 400.0),
    )
    yield Item(
        "pot",
        revolved(_POT, position(-30.0, 3900.0)),
        Finish("matte", plaster(next(seeds), (0.45, 0.24, 0.15), 0.15), 400.0),
    )
    yield Item("can", revolved(_CAN, position(80.0, 3300.0)), Finish("satin", label, 390.0, roughness=0.1))
    yield Item(
        "box",
        block((260.0, 180.0, 340.0), position(-420.0, 4100.0), 28.0),
        Finish("satin", weave(next(seeds), (0.42, 0.16, 0.14)), 330.0),
    )
    yield Item(
        "tray",
        block((360.0, 260.0, 16.0), position(-360.0, 2900.0), -16.0),
        Finish("metal", colour=(0.72, 0.72, 0.74), roughness=0.3),
    )
    yield Item(
        "tin",
        block((170.0, 170.0, 260.0), position(330.0, 4350.0), 40.0),
        Finish("metal", colour=(0.75, 0.72, 0.66), roughness=0.22),
    )


def gloss(seed: int) -> Scene:
    """Return the scene; the seed determines textures and small shifts."""
    random = np.random.default_rng(seed)
    seeds = iter(random.integers(0, 2**31, 16).tolist())
    wood = planks(next(seeds), (0.34, 0.20, 0.11), boards=7)
    poster = resized(texture("poster", (1024, 1024), next(seeds)))
    label = resized(texture("label", (1024, 1024), next(seeds)))
    items = (
        *_room(seeds, wood, poster),
        *_objects(random, seeds, label),
        Item(
            "room behind",
            sheet((-4000.0, -1500.0, -750.0), (8000.0, 0.0, 0.0), (0.0, 0.0, 4200.0)),
            Finish("matte", bricks(next(seeds), (0.35, 0.33, 0.3)), 2500.0),
        ),
    )
    lamps = (
        Lamp((-1700.0, 2200.0, 2600.0), (0.0, 3500.0, 100.0), (550.0, 550.0), (24.0, 22.5, 20.0)),
        Lamp((1900.0, 4800.0, 2700.0), (-200.0, 6800.0, 500.0), (450.0, 450.0), (20.0, 21.0, 23.0)),
    )
    return Scene(items, lamps, (0.22, 0.24, 0.28), eye_mm=760.0, pitch_deg=6.0)
