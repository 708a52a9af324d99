"""Tolerance analysis: figures of many perturbed devices of a design, drawn at random (Monte Carlo)."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mirrorcam.core.values import FloatArray, InputError
from mirrorcam.optics.design.assess.as_built_metrics import UNITS, design_reference
from mirrorcam.optics.design.assess.as_built_views import BuiltViews, built_views
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.perturbations import draw_perturbations, workmanship
from mirrorcam.optics.geometry.tolerances import Tolerances

DEVICES = 200
ACCURACIES = (0.25, 0.5, 1.0, 2.0)
LOW, HIGH = 5.0, 95.0

CAUSES: dict[str, tuple[str, ...]] = {
    "mirror tilt": ("tilt_deg",),
    "mirror offset": ("offset_mm",),
    "sheet thickness": ("sheet_thickness_mm",),
    "camera offset": ("camera_offset_mm",),
    "camera turn": ("camera_turn_deg",),
    "camera itself": ("focal_percent", "centre_px", "distortion_mean", "distortion_sigma"),
}


@dataclass(frozen=True)
class Spread:
    """One figure over many devices: its value for the design, its median and the range of 90 % of the devices."""

    nominal: float
    low: float
    median: float
    high: float
    unit: str


@dataclass(frozen=True)
class Study:
    """The tolerance analysis of a layout.

    Attributes
    ----------
    tolerances
        The tolerances of `spreads[1.0]`.
    devices
        Number of devices drawn.
    spreads
        Spread of each figure, by accuracy (a factor on the tolerances of printing and assembling; those of the camera
        stay), then by figure.
    hidden
        Fraction of devices in which a mirror hides a part of another from the camera, by accuracy.
    shares
        Mean square deviation from the design with one tolerance alone, as a fraction of the sum over causes, by cause,
        then by figure. For a figure that depends linearly, that is its share of the variance.
    """

    tolerances: Tolerances
    devices: int
    spreads: dict[float, dict[str, Spread]]
    hidden: dict[float, float]
    shares: dict[str, dict[str, float]]


def study(
    layout: Layout, tolerances: Tolerances, depths_mm: Sequence[float], *, devices: int = DEVICES, seed: int = 0
) -> Study:
    """Draw devices at each accuracy and with each cause alone, each time from the same random numbers.

    Parameters
    ----------
    layout : the design.
    tolerances : standard deviations.
    depths_mm : working depths.
    devices : number of devices.
    seed : of the random generator.

    Raises
    ------
    InputError : views share nothing at a depth, or a drawn device could not be built, also at the coarsest accuracy,
        twice the tolerances.
    """
    ideal = design_reference(layout, depths_mm)
    nominal = {name: float(values[0]) for name, values in ideal.figures(ideal.design).items()}
    spreads, hidden, squares = {}, {}, {}
    for accuracy in ACCURACIES:
        views = _drawn(layout, tolerances, devices, seed, accuracy)
        spreads[accuracy] = {
            name: _spread(name, nominal[name], values) for name, values in ideal.figures(views).items()
        }
        hidden[accuracy] = float(views.hidden().mean())
    for cause, names in CAUSES.items():
        alone = tolerances.only(*names)
        if alone != Tolerances.none():
            drawn = ideal.figures(_drawn(layout, alone, devices, seed))
            squares[cause] = {name: float(np.mean((drawn[name] - nominal[name]) ** 2)) for name in nominal}
    return Study(tolerances, devices, spreads, hidden, _shares(squares))


def _drawn(layout: Layout, tolerances: Tolerances, devices: int, seed: int, accuracy: float = 1.0) -> BuiltViews:
    random = np.random.default_rng(seed)
    try:
        return built_views(layout, draw_perturbations(tolerances.times(accuracy), len(layout.mirrors), devices, random))
    except InputError as error:
        times = "" if accuracy == 1.0 else f", {accuracy:g} times that"
        raise InputError(f"tolerances {workmanship(tolerances)}{times}: {error}") from None


def _spread(name: str, nominal: float, values: FloatArray) -> Spread:
    low, median, high = (float(v) for v in np.percentile(values, [LOW, 50.0, HIGH]))
    return Spread(nominal, low, median, high, UNITS[re.sub(r"_[0-9.e+]+mm$", "", name)])


def _shares(squares: Mapping[str, Mapping[str, float]]) -> dict[str, dict[str, float]]:
    figures = next(iter(squares.values()), {})
    total = {name: sum(of_cause[name] for of_cause in squares.values()) for name in figures}
    return {
        cause: {name: value / total[name] if total[name] > 0 else 0.0 for name, value in of_cause.items()}
        for cause, of_cause in squares.items()
    }
