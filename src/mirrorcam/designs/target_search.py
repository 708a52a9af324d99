"""Search the smallest designs that meet a target, over number of mirrors, scale and fold, then over common mirrors.

Unoptimised sketches of a few scales predict the figures of every number of mirrors: logarithms of figures are almost
linear in the logarithm of the scale. The most promising ones are designed, and the difference between the figures of a
design and those of its sketch corrects the prediction of others.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from itertools import product
from typing import Self

import numpy as np

from mirrorcam.cad.plan.hardware import HARDWARE, Hardware
from mirrorcam.core.arguments import check_callable
from mirrorcam.core.bounds import FOLD_DEG
from mirrorcam.core.errors import InputError
from mirrorcam.core.processes.calls import Calls, in_turn
from mirrorcam.core.progress import Progress, no_progress
from mirrorcam.core.values import FloatArray, InvalidValue, Value
from mirrorcam.designs.target import Target, TargetDesign, front_mm, measure
from mirrorcam.optics.design.preview import sketch
from mirrorcam.optics.design.spec_grid import Outcome, solve
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror_stock import STOCK_FIELDS, STOCKS, narrowest, stock_fields
from mirrorcam.optics.geometry.rectangle_sizes import RECTANGLES, SOLD_SIZES

MIRRORS = (*STOCK_FIELDS, "shape")
"""Fields of the mirrors, which the search chooses only if no design with the specification's meets the target."""
VARIED = ("rows", "cols", "scale_mm", "fold_deg", "depths_mm", *MIRRORS)
"""Fields of a specification that the search may choose; the depths are then the target's distances."""
COUNTS = (1, 2, 3, 4)
"""Numbers of rows and of columns that are tried."""
SCALES_MM = (32.0, 50.0, 80.0, 125.0, 190.0)
"""Scales of the sketches, between which the search chooses to a millimetre."""
FOLD_STEP_DEG, FOLDED = 12.0, 3
"""Change of the fold that is tried, and the number of the most promising counts for which it is."""
RECUT = 2
"""Number of the most promising counts for which other mirrors are tried."""
ROUNDS, PER_ROUND = 4, 2
"""Largest number of rounds, and of designs in each, which are made at the same time."""
SAME_SCALE_MM = 0.5
"""Difference of scales below which a design is not made again."""
OTHERS = 10.0
"""Weight of the other terms, which shall hold, while one gives way."""
MIN_GAIN = 0.05
"""Predicted improvement for which another design is made."""
SKETCH_SIGMA = 0.22
"""Logarithm of the ratio of a design's standard deviation of depth to that of its sketch, before one is made."""
MARGIN, NEAR_MARGIN, MARGIN_SHARE = 0.01, 0.3, 0.2
"""Logarithm of the margin with which predicted figures but prices meet their limits before a design is made; afterwards
this share of it, and a share of the predicted change."""
SCALE_STEP = 1.15
"""Factor on a scale at which there is no design."""
MOST = 3
"""Largest number of designs that meet a target."""
TOO_NARROW = "mirrors are too narrow to be cut from their stock"


class TargetDesigns(Value):
    """The answer to a target: designs that meet it, best first, or the nearest ones, whose terms give way.

    Designs that meet the target differ in their numbers of mirrors, and the smallest device is first. If only designs
    with other mirrors than the specification's meet it, the nearest one with those follows them. If none meets it,
    there are at most two with the specification's mirrors, in which different terms give way, and one with others
    that comes nearer.
    """

    target: Target
    designs: tuple[TargetDesign, ...]

    @property
    def met(self) -> bool:
        """Whether the designs meet all terms."""
        return self.designs[0].meets


def designs_for(
    target: Target | str | Sequence[str],
    spec: DesignSpec | None = None,
    *,
    vary: Collection[str] = VARIED,
    known: Iterable[Layout] = (),
    hardware: Hardware = HARDWARE,
    calls: Calls = in_turn,
    progress: Progress = no_progress,
) -> TargetDesigns:
    """Find designs that meet a target, or the nearest ones.

    Parameters
    ----------
    target
        Terms, such as `"0.3mm@400mm 150x120mm@400mm 300g 8h"` (`Target.of`).
    spec
        Camera, mirrors, and all other fields that are not varied.
    vary
        Fields that the search chooses, of `VARIED`: rows and columns up to four, scale, fold, and as working depths the
        distances of the target, and common mirrors if none meets the target with those of `spec`. A pattern fixes the
        number of mirrors.
    known
        Designs that are candidates too, if they have the camera of `spec`.
    hardware
        Dimensions and prices of the device.
    calls
        Makes independent designs, in this process or in two; the result is the same.
    progress
        Called with the number of sketched numbers of mirrors and designs done, and of all.

    Returns
    -------
    TargetDesigns
        At most three designs that meet the target, or that come nearest.

    Raises
    ------
    InputError
        For an invalid target, a distance nearer than any device, an unknown field in `vary`, or if no design was found.
    """
    check_callable("progress", progress)
    target = target if isinstance(target, Target) else Target.of(target)
    if unknown := set(vary) - set(VARIED):
        raise InputError(f"vary: {min(unknown)}, expected some of {', '.join(VARIED)}")
    spec = DesignSpec() if spec is None else spec
    if "depths_mm" in vary and target.depths_mm:
        spec = spec.replaced(depths_mm=target.depths_mm)
    scales = SCALES_MM if "scale_mm" in vary else (spec.scale_mm,)
    search = _Search(target, hardware, scales, spec)
    counts = _counts(spec, vary)
    total = len(counts) + ROUNDS * PER_ROUND
    for done, number in enumerate(counts):
        progress(done, total)
        search.add(spec.replaced(rows=number[0], cols=number[1]))
    if "fold_deg" in vary and spec.fold_deg != "auto":
        for common, change in product(search.most_promising(FOLDED), (-FOLD_STEP_DEG, FOLD_STEP_DEG)):
            search.add(common.replaced(fold_deg=min(max(float(spec.fold_deg) + change, FOLD_DEG.min), FOLD_DEG.max)))
    search.require_distances()
    same_camera = [layout for layout in known if layout.spec is not None and layout.spec.camera == spec.camera]
    for layout in same_camera:
        search.take_in(layout, others=False)
    may_add_others = set(MIRRORS) <= set(vary)
    done = len(counts)
    while done < total:
        chosen = search.chosen()
        may_meet = search.met or any(choice.cost.missed == 0.0 for choice in chosen)
        if may_add_others and not may_meet and (done > len(counts) or not chosen):
            may_add_others = False
            for layout in same_camera:
                search.take_in(layout, others=True)
            for common in search.most_promising(RECUT):
                for other in _with_other_mirrors(common):
                    search.add(other)
            continue
        if not chosen:
            break
        with closing(calls([(solve, (choice.spec,)) for choice in chosen])) as solved:
            for choice, (outcome, layout) in zip(chosen, solved, strict=True):
                search.learn(choice, outcome, layout)
                done += 1
                progress(done, total)
    for layout in same_camera if may_add_others and not search.met else ():
        search.take_in(layout, others=True)
    progress(total, total)
    return search.result()


def _counts(spec: DesignSpec, vary: Collection[str]) -> list[tuple[int, int]]:
    """The numbers of rows and columns to try."""
    free = set(vary) if spec.pattern is None else set()
    rows = COUNTS if "rows" in free else (spec.rows,)
    cols = COUNTS if "cols" in free else (spec.cols,)
    return [number for number in product(rows, cols) if number != (1, 1)]


def _with_other_mirrors(spec: DesignSpec) -> Iterator[DesignSpec]:
    """The specification with common mirrors other than its own, in its shape, and sold in sizes or cut."""
    sizes = spec.rectangle_sizes
    other_shape = RECTANGLES if sizes is not None and sizes.is_stock else SOLD_SIZES
    for name, shape in product(STOCKS, ({}, {"shape": other_shape, "sides": 4})):
        try:
            other = spec.replaced(**stock_fields(name), **shape)
        except InvalidValue:
            continue  # such as mirrors smaller than the smallest edge
        if other != spec:
            yield other


@dataclass(eq=False)
class _Family:
    """Designs that differ only in scale, `least_mm` to `largest_mm`.

    `figures` (k, terms + 1) of sketches at scales (k,) are the excess of each term and the logarithm of the device's
    size; `corrections` are the differences of the designs at `solved_mm` from the sketches.
    """

    spec: DesignSpec
    scales_mm: FloatArray
    figures: FloatArray
    least_mm: float
    largest_mm: float
    solved_mm: list[float] = field(default_factory=list)
    corrections: list[FloatArray] = field(default_factory=list)

    @property
    def candidates_mm(self) -> FloatArray:
        """Scales (n,) to choose from: whole millimetres, or the only scale."""
        if len(self.scales_mm) == 1:
            return self.scales_mm[(self.scales_mm >= self.least_mm) & (self.scales_mm <= self.largest_mm)]
        return np.arange(np.ceil(self.least_mm), self.largest_mm + 0.5)

    def sketched(self, scales_mm: FloatArray) -> FloatArray:
        """Figures (n, terms + 1) of sketches at scales (n,), interpolated in the logarithm of the scale."""
        logs = np.log(self.scales_mm)
        return np.column_stack([np.interp(np.log(scales_mm), logs, column) for column in self.figures.T])

    def predicted(self, scales_mm: FloatArray, common: FloatArray, margins: FloatArray) -> FloatArray:
        """Figures (n, terms + 1) of designs with a margin, corrected as at the nearest, or all by `common`."""
        sketched = self.sketched(scales_mm)
        if not self.corrections:
            return sketched + common + margins
        nearest = np.abs(np.log(scales_mm[:, None] / self.solved_mm)).argmin(axis=1)
        change = sketched - self.sketched(np.array(self.solved_mm))[nearest]
        corrected = sketched + np.array(self.corrections)[nearest]
        return np.asarray(corrected + NEAR_MARGIN * margins + MARGIN_SHARE * np.abs(change))


@dataclass(frozen=True, order=True)
class _Cost:
    """How far a design is from a target: what the terms that shall hold miss and the one that may give way, weighted.

    Of designs that meet the target, the smallest device, with the least logarithm of `size`, has the lowest cost.
    """

    missed: float
    size: float
    others: float

    @classmethod
    def of(cls, figures: FloatArray, yields: int) -> Self:
        """The cost of figures (terms + 1,) if one term may give way."""
        missed = np.maximum(figures[:-1], 0.0)
        others = float(missed.sum() - missed[yields])
        return cls(float(missed[yields]) + OTHERS * others, float(figures[-1]), others)

    def improves(self, other: _Cost) -> bool:
        """Whether this cost is lower by the smallest gain."""
        if self.missed == 0.0:
            return other.missed > 0.0 or self.size + MIN_GAIN < other.size
        return self.missed + MIN_GAIN < other.missed


@dataclass(frozen=True)
class _Choice:
    """A design to make: its family and scale, the term that may give way, and the predicted cost."""

    family: _Family
    scale_mm: float
    yields: int
    cost: _Cost

    @property
    def spec(self) -> DesignSpec:
        return self.family.spec.replaced(scale_mm=self.scale_mm)

    @property
    def counts(self) -> tuple[int, int]:
        return self.family.spec.rows, self.family.spec.cols

    @property
    def kind(self) -> object:
        """The numbers of mirrors of a design that meets the target, else the term that gives way."""
        return self.yields if self.cost.missed > 0.0 else self.counts


class _Search:
    """Families of designs, and the designs made so far."""

    def __init__(self, target: Target, hardware: Hardware, scales_mm: Sequence[float], spec: DesignSpec) -> None:
        self._target, self._hardware, self._scales_mm, self._spec = target, hardware, scales_mm, spec
        self._front_mm: list[float] = []
        self._families: list[_Family] = []
        self._designs: list[TargetDesign] = []
        self._refusal = ""

    def add(self, spec: DesignSpec) -> None:
        """Sketch the designs of a specification at all scales; without a sketch, there is no family."""
        found: dict[float, FloatArray] = {}
        least_mm = 0.0
        for scale_mm in self._scales_mm:
            try:
                layout = sketch(spec.replaced(scale_mm=scale_mm))
            except InputError as refusal:
                self._refusal = str(refusal)
                continue
            found[scale_mm] = self._figures(measure(layout, self._target, self._hardware))
            self._front_mm.append(front_mm(layout))
            # Widths are proportional to the scale; those that are sold are not sketched.
            sizes = spec.rectangle_sizes
            least_mm = 0.0 if sizes is not None and sizes.is_stock else scale_mm / narrowest(layout)
        if found:
            least_mm = max(least_mm, min(found))
            if least_mm > max(found):
                self._refusal = TOO_NARROW
            scales, figures = np.array(list(found)), np.array(list(found.values()))
            self._families.append(_Family(spec, scales, figures, least_mm, max(found)))

    def require_distances(self) -> None:
        """Raise InputError if a distance is nearer than the fronts of all sketched devices."""
        front_mm = min(self._front_mm, default=0.0)
        if self._target.depths_mm and self._target.depths_mm[0] <= front_mm:
            raise InputError(
                f"the distance {self._target.depths_mm[0]:g} mm is nearer than the device, which reaches at least "
                f"{front_mm:.0f} mm in front of the lens: expected a larger one"
            )

    def take_in(self, layout: Layout, *, others: bool) -> None:
        """Take in a design made before, if it has the specification's mirrors or, of `others`, different ones."""
        if self._is_other(layout) != others or narrowest(layout) < 1.0:
            return
        try:
            design = measure(layout, self._target, self._hardware)
        except InputError:
            return  # no device stands like this
        self._designs.append(design)
        for family in self._families:
            scale_mm = layout.designed_spec.scale_mm
            if family.spec.replaced(scale_mm=scale_mm) == layout.spec:
                self._correct(family, scale_mm, design)

    def _is_other(self, layout: Layout) -> bool:
        """Whether a design differs from the specification in more than the fields to choose first, such as mirrors."""
        same = set(DesignSpec.model_fields) - (set(VARIED) - set(MIRRORS))
        return any(getattr(layout.spec, name) != getattr(self._spec, name) for name in same)

    @property
    def met(self) -> bool:
        """Whether a design meets the target."""
        return any(design.meets for design in self._designs)

    def most_promising(self, count: int) -> list[DesignSpec]:
        """The specifications with the lowest predicted costs, one for each number of mirrors."""
        best: dict[object, DesignSpec] = {}
        for choice in self._choices():
            best.setdefault(choice.counts, choice.family.spec)
        return list(best.values())[:count]

    def chosen(self) -> list[_Choice]:
        """The designs to make next, each of which promises to be among the results.

        They differ in their numbers of mirrors, or in the only term that gives way.
        """
        chosen: list[_Choice] = []
        for choice in self._choices():
            is_new = all(abs(choice.scale_mm - scale) >= SAME_SCALE_MM for scale in choice.family.solved_mm)
            is_new &= all(choice.kind != other.kind and choice.spec != other.spec for other in chosen)
            if is_new and self._is_better(choice):
                chosen.append(choice)
            if len(chosen) == PER_ROUND:
                break
        return chosen

    def _is_better(self, choice: _Choice) -> bool:
        """Whether a choice improves on the designs made: with its number of mirrors, or in which its term gives way."""
        made = self._by_cost(self._designs)
        met = {counts_of(design): cost for cost, design, _ in reversed(made) if design.meets}
        if choice.counts in met:
            return choice.cost.improves(met[choice.counts])
        if met:
            is_among_best = len(met) < MOST or choice.cost.improves(sorted(met.values())[MOST - 1])
            return choice.cost.missed == 0.0 and is_among_best
        same = [cost for cost, _, yields in made if yields == choice.yields]
        is_alone = choice.cost.others == 0.0
        return not made or (choice.cost.improves(same[0]) and (is_alone or choice.cost.improves(made[0][0])))

    def _by_cost(self, designs: Iterable[TargetDesign]) -> list[tuple[_Cost, TargetDesign, int]]:
        """Designs for every term that may give way, by increasing cost."""
        pairs = product(designs, range(len(self._target.terms)))
        costs = [(_Cost.of(self._figures(design), yields), design, yields) for design, yields in pairs]
        return sorted(costs, key=lambda each: each[0])

    def _choices(self) -> list[_Choice]:
        """The best scale of every family for every term that may give way, by increasing predicted cost."""
        corrections = [correction for family in self._families for correction in family.corrections]
        initial = [SKETCH_SIGMA if term.kind == "depth_sigma" else 0.0 for term in self._target.terms]
        is_price = np.array([*(term.kind in ("price", "parts_price") for term in self._target.terms), True])
        margins = np.where(is_price, 0.0, MARGIN)
        common = np.mean(corrections, axis=0) if corrections else np.array([*initial, 0.0])
        choices = []
        for family in self._families:
            scales = family.candidates_mm
            if len(scales) == 0:
                continue
            predicted = family.predicted(scales, common, margins)
            for yields in range(len(self._target.terms)):
                costs = [_Cost.of(figures, yields) for figures in predicted]
                best = min(range(len(scales)), key=costs.__getitem__)
                choices.append(_Choice(family, float(scales[best]), yields, costs[best]))
        return sorted(choices, key=lambda choice: choice.cost)

    def learn(self, choice: _Choice, outcome: Outcome, layout: Layout | None) -> None:
        """Take in a design, or that there is none at its scale."""
        family, scale_mm = choice.family, choice.scale_mm
        if layout is None:
            self._refusal = outcome.finding
            if outcome.constraint == "depth":
                family.largest_mm = scale_mm / SCALE_STEP
            else:
                family.least_mm = scale_mm * SCALE_STEP
            return
        design = measure(layout, self._target, self._hardware)
        self._correct(family, scale_mm, design)
        if narrowest(layout) < 1.0:
            family.least_mm = scale_mm / narrowest(layout)
            self._refusal = TOO_NARROW
            return
        self._designs.append(design)

    def _correct(self, family: _Family, scale_mm: float, design: TargetDesign) -> None:
        family.solved_mm.append(scale_mm)
        family.corrections.append(self._figures(design) - family.sketched(np.array([scale_mm]))[0])

    @staticmethod
    def _figures(design: TargetDesign) -> FloatArray:
        return np.array([*design.excess.values(), design.log_size])

    def result(self) -> TargetDesigns:
        """The best designs; raises InputError if none was made."""
        if not self._designs:
            raise InputError(f"no design was found for {self._target.text}: {self._refusal}")
        own, others = ([d for d in self._designs if self._is_other(d.layout) == other] for other in (False, True))
        designs = _smallest(own)[:MOST]
        if not designs and (met := _smallest(others)):
            designs = [*met[: MOST - 1], *self._nearest(own)[:1]]
        elif not designs:
            designs, nearer = self._nearest(own)[:2], self._nearest(others)[:1]
            if not designs or (nearer and self._by_cost(nearer)[0][0].improves(self._by_cost(designs)[0][0])):
                designs = [*nearer, *designs]
        return TargetDesigns(target=self._target, designs=tuple(designs))

    def _nearest(self, designs: Sequence[TargetDesign]) -> list[TargetDesign]:
        """The design that comes nearest, then those in which only another term gives way."""
        nearest: dict[object, TargetDesign] = {}
        for cost, design, yields in self._by_cost(designs):
            alone = design.gives_way[0] == self._target.terms[yields].text and cost.others < 2.0 * MARGIN
            if alone or not nearest:
                nearest.setdefault(design.gives_way[0], design)
        return list(nearest.values())


def _smallest(designs: Iterable[TargetDesign]) -> list[TargetDesign]:
    """The smallest designs that meet the target, one for each number of mirrors."""
    best: dict[object, TargetDesign] = {}
    for design in sorted((each for each in designs if each.meets), key=lambda each: each.log_size):
        best.setdefault(counts_of(design), design)
    return list(best.values())


def counts_of(design: TargetDesign) -> tuple[int, int]:
    """Numbers of rows and columns of a design's mirrors."""
    return design.layout.rows, design.layout.cols
