"""Arrangements of chains of mirrors from which the search for the best ones starts."""

from __future__ import annotations

import numpy as np

from benchmarks.two_bounces_chains import SQUARE, Chain, Question
from mirrorcam.core.values import FloatArray

MEETING_MM = 400.0


def chain_through(cell: FloatArray, places_mm: FloatArray, target_mm: FloatArray) -> Chain:
    """The chain whose chief ray, through the middle of a cell, runs over places (bounces, 3) to a target (3,)."""
    stops = np.vstack([np.zeros(3), places_mm, target_mm])
    ways = np.diff(stops, axis=0)
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    normals = ways[:-1] - ways[1:]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Chain(normals, (normals * places_mm).sum(axis=1), np.zeros((len(normals), 4, 3)), cell)


def cells_of(question: Question, fill: float) -> list[FloatArray]:
    """Equal cells (4, 2) of the sensor, row by row, of which a part is used."""
    half = question.half_field / (question.cols, question.rows)
    return [
        half * (2.0 * np.array([s, t]) + 1.0 - (question.cols, question.rows)) + fill * half * SQUARE
        for t in range(question.rows)
        for s in range(question.cols)
    ]


def one_bounce(question: Question, distance_mm: float, fill: float) -> list[Chain]:
    """Facets of a mirror at a distance along the axis, all aimed at one point."""
    turn = question.view_from_rig.T
    meet = turn @ np.array([0.0, 0.0, MEETING_MM]) + np.array([0.0, 0.0, distance_mm])
    axis = turn @ np.array([0.0, 0.0, 1.0])
    normal = np.array([0.0, 0.0, 1.0]) - axis
    chains = []
    for cell in cells_of(question, fill):
        ray = np.append(cell.mean(axis=0), 1.0)
        place = ray * distance_mm * normal[2] / (normal @ ray)
        chains.append(chain_through(cell, place[None], meet))
    return chains


def ladder(question: Question, first_mm: float, way_mm: float, fill: float, sign: float = 1.0) -> list[Chain]:
    """Facets of a mirror that turn all light up (or down), and of another that turns it to the views."""
    turn = question.view_from_rig.T
    out = turn @ np.array([0.0, 0.0, 1.0])
    between = np.array([0.0, -sign, 0.0])
    middle = np.array([0.0, 0.0, first_mm]) + way_mm * between
    meet = middle + MEETING_MM * out
    chains = []
    for cell in cells_of(question, fill):
        ray = np.append(cell.mean(axis=0), 1.0)
        normal = np.array([0.0, 0.0, 1.0]) - between
        first = ray * first_mm * normal[2] / (normal @ ray)
        image = ray - 2.0 * (ray @ normal) / (normal @ normal) * normal
        facet = between - out
        reach = ((middle - first) @ facet) / (image @ facet)
        chains.append(chain_through(cell, np.array([first, first + reach * image]), meet))
    return chains


def star(question: Question, first_mm: float, way_mm: float, fill: float) -> list[Chain]:
    """Facets of a pyramid that turn the light of each view outwards, and mirrors around that turn it to the scene."""
    meet = question.view_from_rig.T @ np.array([0.0, 0.0, MEETING_MM])
    chains = []
    for cell in cells_of(question, fill):
        middle = cell.mean(axis=0)
        first = np.append(middle, 1.0) * first_mm
        outwards = np.append(np.sign(np.round(middle, 6)), 0.0)
        outwards[:2] *= (1.0, 0.8) if question.rows > 1 else (1.0, 0.0)
        if not outwards.any():
            outwards = np.array([0.0, -1.0, 0.0])
            first = first * 0.8
        outwards /= np.linalg.norm(outwards)
        chains.append(chain_through(cell, np.array([first, first + way_mm * outwards]), meet))
    return chains
