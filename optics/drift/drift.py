"""Whether mirrors turned or shifted since the calibration: a likelihood-ratio test of each mirror, one after another.

Under the null hypothesis, errors of the calibration (its covariance), small motions of every mirror (FLOOR_DEG,
FLOOR_MM) and any common motion of all mirrors explain what is seen. Against it, one mirror may have moved freely. The
mirror that gains most is taken to have moved, if it gains more than chance gives in one recording of RECORDINGS, and
the others are tested again. How far it may have moved is not known beforehand: the likelihood is averaged over sizes of
motion. By Markov's inequality, such a ratio is beyond a number with a probability of no more than one over it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.calibration_result import moved_to
from mirrorcam.optics.drift.matched_points import IntArray, MatchedPoints
from mirrorcam.optics.drift.mirror_motions import (
    COMMON_DEG,
    all_rows,
    calibration_covariance,
    common_covariance,
    common_motions,
    hinged_motion,
    mirror_rows,
    own_motion,
    placed,
    turn_of_centre,
    turns_about_middle,
)
from mirrorcam.optics.drift.scene_fit import SceneFit, SceneInformation, parameter_names
from mirrorcam.optics.geometry.layout import Layout, Uncertainty

LEAST_MIRRORS = 3
"""With two mirrors, a turn of one cannot be distinguished from a turn of the camera in front of both."""
RECORDINGS = 10_000
"""One false alarm in so many recordings where nothing moved, at most."""
FLOOR_DEG, FLOOR_MM = 0.001, 0.006
"""Standard deviations of what is no drift: matching has common errors of some hundredths of a pixel, and no holder is
stiffer."""
WIDE_DEG, WIDE_MM = 1.0, 1.0
"""Standard deviations of the turn and the shift of a mirror that moved."""
TURNS_DEG = np.geomspace(0.005, 5.0, 13).tolist()
"""Standard deviations of turns over which the likelihood is averaged."""
WANTED_DEG = 0.02
"""A turn that the test must detect."""
MISSED = 1.64
"""Turns of this many standard deviations beyond the threshold are detected in 19 of 20 recordings."""
LEAST_POINTS = 30
"""A mirror that shows fewer points is not tested."""
MOST_SIGMA_PX = 0.2
"""Matches of a frame that scatter more, however mirrors may have moved, are wrong."""
UNDETERMINED_DEG = 90.0
LEAST_LEFT = 0.25
"""Part of the clear corners of a frame that other views show, where it is of the layout's mirrors."""


def shows_drift(layout: Layout) -> bool:
    """Whether a layout states measured mirrors that pictures can be compared with: LEAST_MIRRORS, not as designed."""
    return layout.kind != "nominal" and len(layout.mirrors) >= LEAST_MIRRORS


@dataclass(frozen=True)
class MirrorMove:
    """The motion of one mirror as the pictures show it.

    Attributes
    ----------
    index
        Of the mirror.
    turn_deg
        Rotation vector (3,) in rig, without the turn about the normal.
    shift_mm
        Shift along the normal, towards the pupil.
    turn_sigma_deg
        Standard deviation of the turn, along its worst direction.
    statistic
        Logarithm of the likelihood ratio, in units of the threshold.
    tells_deg
        Turns of this size are detected in 19 of 20 recordings, whatever their direction.
    points
        Number of points that the mirror shows.
    moved
        Whether it moved.
    """

    index: int
    turn_deg: FloatArray
    shift_mm: float
    turn_sigma_deg: float
    statistic: float
    tells_deg: float
    points: int
    moved: bool

    @property
    def tested(self) -> bool:
        """Whether the pictures show enough of it that its other figures mean something."""
        return self.tells_deg < UNDETERMINED_DEG

    @property
    def size_deg(self) -> float:
        """The turn's angle."""
        return float(np.linalg.norm(self.turn_deg))


@dataclass(frozen=True)
class Drift:
    """The motions of the mirrors as a recording shows them.

    Attributes
    ----------
    mirrors
        Of each mirror by itself.
    names
        Parameters that the following are of.
    change
        What the moved mirrors changed by (g,).
    covariance
        Covariance (g, g) of the parameters of the changed layout.
    common_turn_deg, common_turn_sigma_deg
        Rotation vector (3,) in rig of all mirrors together, and its standard deviations: little of it is seen.
    frames, points
        Numbers of frames, and of the points matched in them.
    sigma_px
        Standard deviation of a match, per axis.
    unlike
        Whether most frames have clear detail that this layout's mirrors would not show so: few corners are found in
        other views, or none at places that a motion of mirrors explains.
    """

    mirrors: tuple[MirrorMove, ...]
    names: tuple[str, ...]
    change: FloatArray
    covariance: FloatArray
    common_turn_deg: FloatArray
    common_turn_sigma_deg: FloatArray
    frames: int
    points: int
    sigma_px: float
    unlike: bool = False

    @property
    def moved(self) -> tuple[MirrorMove, ...]:
        """The mirrors that moved."""
        return tuple(mirror for mirror in self.mirrors if mirror.moved)

    @property
    def untold(self) -> tuple[MirrorMove, ...]:
        """The mirrors of which the pictures show too little to detect a turn of WANTED_DEG."""
        return tuple(mirror for mirror in self.mirrors if mirror.tells_deg > WANTED_DEG)


def find_drift(layout: Layout, matches: MatchedPoints) -> Drift:
    """Test the mirrors of a calibrated layout by points that its views show."""
    names, mirrors = parameter_names(layout), layout.mirrors
    shown = np.bincount(matches.view, minlength=len(mirrors))
    if (shown >= LEAST_POINTS).sum() < 2:
        return _nothing(layout, names, shown.tolist(), matches)
    calibrated, common = calibration_covariance(layout, names), common_covariance(layout, names)
    small = placed({k: own_motion(mirror, FLOOR_DEG, FLOOR_MM) for k, mirror in enumerate(mirrors)}, names)
    wide = placed({k: own_motion(mirror, WIDE_DEG, WIDE_MM) for k, mirror in enumerate(mirrors)}, names)
    prior = calibrated + common + small + wide
    matches = understood(layout, matches, prior)
    shown = np.bincount(matches.view, minlength=len(mirrors))
    if (shown >= LEAST_POINTS).sum() < 2:
        return _nothing(layout, names, shown.tolist(), matches)
    scene = SceneFit(layout, matches, prior).solve()
    information, gradient = deflated(scene)
    return _Test(layout, names, scene, information, gradient, calibrated, small, common).run()


def understood(layout: Layout, matches: MatchedPoints, prior: FloatArray) -> MatchedPoints:
    """The points of frames that some motion of the mirrors explains; of others, matches are wrong."""
    kept = np.zeros(len(matches.point), dtype=bool)
    for frame in np.unique(matches.frame):
        rows = matches.frame[matches.point] == frame
        kept[rows] = SceneFit(layout, matches.where(rows), prior).solve().sigma_px <= MOST_SIGMA_PX
    return matches.where(kept)


def _nothing(layout: Layout, names: tuple[str, ...], shown: list[int], matches: MatchedPoints) -> Drift:
    """The result of too few points."""
    mirrors = tuple(
        MirrorMove(k, np.zeros(3), 0.0, WIDE_DEG, 0.0, UNDETERMINED_DEG, count, moved=False)
        for k, count in enumerate(shown)
    )
    return Drift(
        mirrors=mirrors,
        names=names,
        change=np.zeros(len(names)),
        covariance=calibration_covariance(layout, names),
        common_turn_deg=np.zeros(3),
        common_turn_sigma_deg=np.full(3, COMMON_DEG),
        frames=0,
        points=len(matches.frame),
        sigma_px=0.0,
        unlike=_unlike(matches),
    )


def _unlike(matches: MatchedPoints) -> bool:
    """Whether few of the clear corners of most frames are left where a motion of mirrors explains them."""
    left = np.bincount(matches.frame, minlength=len(matches.clear))
    strange = (matches.clear >= LEAST_POINTS) & (left < LEAST_LEFT * matches.clear)
    return bool(2 * strange.sum() > len(strange))


def deflated(scene: SceneInformation) -> tuple[FloatArray, FloatArray]:
    """H and h, less as errors of neighbouring points are alike: by how the sums over cells scatter."""
    root = np.sqrt(np.maximum(np.diag(scene.information), 1e-300))
    values, vectors = np.linalg.eigh(scene.information / np.outer(root, root))
    kept = values > 1e-6 * values[-1]
    white = (vectors[:, kept] / np.sqrt(values[kept])).T / root
    inflation = max(1.0, float(np.trace(white @ scene.scatter @ white.T)) / int(kept.sum()))
    return scene.information / inflation, scene.gradient / inflation


@dataclass(frozen=True)
class _Given:
    """What is left where changes have a prior covariance C: (I + H C)^-1 h, and (I + H C)^-1 H."""

    pull: FloatArray
    stiffness: FloatArray

    def gain(self, rows: IntArray, block: FloatArray) -> float:
        """Twice the logarithm of the likelihood ratio of one more motion (3, 3) of the parameters `rows`."""
        inside = np.eye(3) + self.stiffness[np.ix_(rows, rows)] @ block
        pull = self.pull[rows]
        return float(pull @ block @ np.linalg.solve(inside, pull) - np.linalg.slogdet(inside)[1])


@dataclass(frozen=True)
class _Test:
    """The data of a test: H and h of changes, and covariances (g, g) of what is no drift."""

    layout: Layout
    names: tuple[str, ...]
    scene: SceneInformation
    information: FloatArray
    gradient: FloatArray
    calibrated: FloatArray
    small: FloatArray
    common: FloatArray

    def run(self) -> Drift:
        """Let mirrors move as long as one gains more than chance gives."""
        moved: dict[int, FloatArray] = {}
        gains = dict.fromkeys(range(len(self.layout.mirrors)), 0.0)
        tested = [k for k in range(len(self.layout.mirrors)) if self.scene.seen[k] >= LEAST_POINTS]
        while len(moved) < len(tested) - 1:
            given = self._given(moved)
            rest = [k for k in tested if k not in moved]
            gains |= {k: self._mean_gain(given, k) for k in rest}
            best = max(rest, key=lambda k: gains[k])
            if gains[best] <= self.limit:
                break
            moved[best] = self._likely(given, best)
        given, own = self._given(moved), placed(moved, self.names)
        turn, sigma = self._common_turn(given)
        return Drift(
            mirrors=tuple(
                self._move(k, moved, gains.get(k, 0.0) / self.limit) for k in range(len(self.layout.mirrors))
            ),
            names=self.names,
            change=own @ given.pull,
            covariance=self._covariance(own),
            common_turn_deg=turn,
            common_turn_sigma_deg=sigma,
            frames=self.scene.frames,
            points=self.scene.points,
            sigma_px=self.scene.sigma_px,
        )

    @property
    def limit(self) -> float:
        """Twice the logarithm of the likelihood ratio that chance exceeds in one recording of RECORDINGS at most."""
        return 2.0 * float(np.log(RECORDINGS * len(self.layout.mirrors)))

    def _given(self, moved: dict[int, FloatArray]) -> _Given:
        """What is left where some mirrors may have moved."""
        prior = self.calibrated + self.small + self.common + placed(moved, self.names)
        inside = np.eye(len(prior)) + self.information @ prior
        found = np.linalg.solve(inside, np.column_stack([self.gradient, self.information]))
        return _Given(np.asarray(found[:, 0], np.float64), np.asarray(found[:, 1:], np.float64))

    def _mean_gain(self, given: _Given, k: int) -> float:
        """Twice the logarithm of the likelihood ratio of a mirror that moved, in the mean over TURNS_DEG."""
        rows = mirror_rows(self.names, k)
        each = np.array([given.gain(rows, hinged_motion(self.layout.mirrors[k], turn)) for turn in TURNS_DEG])
        return 2.0 * float(logsumexp(each / 2.0) - np.log(len(each)))

    def _likely(self, given: _Given, k: int) -> FloatArray:
        """The motion (3, 3) of a mirror under which the pictures are most likely (empirical Bayes).

        Over a short range of depths, pictures hardly separate a turn from a shift; this bounds the shift by the turn.
        """
        rows = mirror_rows(self.names, k)
        motions = [hinged_motion(self.layout.mirrors[k], turn) for turn in TURNS_DEG]
        return max(motions, key=lambda block: given.gain(rows, block))

    def _common_turn(self, given: _Given) -> tuple[FloatArray, FloatArray]:
        """Rotation vector (3,) of all mirrors together, and standard deviations (3,), deg."""
        motions, rows = common_motions(self.layout), all_rows(self.layout, self.names)
        spread = np.eye(motions.shape[1]) - motions.T @ given.stiffness[np.ix_(rows, rows)] @ motions
        found = motions.T @ given.pull[rows]
        return COMMON_DEG * found[:3], COMMON_DEG * np.sqrt(np.maximum(np.diag(spread)[:3], 0.0))

    def _move(self, k: int, moved: dict[int, FloatArray], statistic: float) -> MirrorMove:
        """The figures of one mirror, as of one that may have moved, beside those that have."""
        without = self._given({m: block for m, block in moved.items() if m != k})
        block = moved[k] if k in moved else self._likely(without, k)
        given = self._given(moved | {k: block})
        rows, mirror = mirror_rows(self.names, k), self.layout.mirrors[k]
        by_turn = turn_of_centre(self.layout, self.names, k)[:, rows]
        change = block @ given.pull[rows]
        spread = by_turn @ (block - block @ given.stiffness[np.ix_(rows, rows)] @ block) @ by_turn.T
        return MirrorMove(
            index=k,
            turn_deg=np.degrees(by_turn @ change),
            shift_mm=float(mirror.normal_in_rig @ change) / 2.0,
            turn_sigma_deg=float(np.degrees(np.sqrt(max(np.linalg.eigvalsh(spread)[-1], 0.0)))),
            statistic=statistic,
            tells_deg=self._tells_deg(without, k),
            points=int(self.scene.seen[k]),
            moved=k in moved,
        )

    def _tells_deg(self, given: _Given, k: int) -> float:
        """The turn about a mirror's middle that is detected in 19 of 20 recordings, in the worst direction.

        Chi squared grows by `least` per squared turn; the mean over sizes of motion costs some of it.
        """
        rows, mirror = mirror_rows(self.names, k), self.layout.mirrors[k]
        turns = np.linalg.svd(mirror.normal_in_rig[None])[2][1:] @ turns_about_middle(mirror)
        least = float(np.linalg.eigvalsh(turns @ given.stiffness[np.ix_(rows, rows)] @ turns.T)[0])
        if self.scene.seen[k] < LEAST_POINTS or least <= 0.0:
            return UNDETERMINED_DEG
        needed = self.limit + 3.0 * np.log(self.limit) + 2.0 * np.log(len(TURNS_DEG))
        return min(float(np.degrees((np.sqrt(needed) + MISSED) / np.sqrt(least))), UNDETERMINED_DEG)

    def _covariance(self, own: FloatArray) -> FloatArray:
        """Covariance of the parameters once the moved mirrors' changes are applied (Joseph's form)."""
        every = np.eye(len(own))
        free = self.calibrated + self.small + self.common + own
        applied = own @ np.linalg.inv(every + self.information @ free)
        left = every - applied @ self.information
        # Small motions of the others pass into the moved mirrors, as the noise does.
        passed = self.information + self.information @ self.small @ self.information
        return np.asarray(left @ (self.calibrated + own) @ left.T + applied @ passed @ applied.T)


def resolved_layout(layout: Layout, drift: Drift, source: str) -> Layout:
    """The layout with the moved mirrors at their new planes, with the covariance of those, and what it is from.

    Mirrors that did not move, and the camera, stay as calibrated. `source` names the recording.
    """
    mirrors = list(layout.mirrors)
    for move in drift.moved:
        mirror = mirrors[move.index]
        change = drift.change[mirror_rows(drift.names, move.index)]
        mirrors[move.index] = moved_to(mirror, mirror.virtual_centre_in_rig_mm + change)
    moved = ", ".join(layout.mirror_names[move.index] for move in drift.moved)
    return layout.replaced(
        mirrors=tuple(mirrors),
        metrics={},
        verdict={},
        uncertainty=_uncertainty(layout, drift),
        provenance=layout.provenance
        | {"resolved_from": layout.identity, "resolved_mirrors": moved, "resolved_by": source},
    )


def _uncertainty(layout: Layout, drift: Drift) -> Uncertainty | None:
    """The covariance of the calibrated parameters, that of the moved mirrors anew; None where there was none."""
    known = layout.uncertainty
    if known is None:
        return None
    places = [(place, drift.names.index(name)) for place, name in enumerate(known.parameters) if name in drift.names]
    rows, columns = np.array(places, dtype=np.int64).T
    covariance = known.covariance.copy()
    covariance[np.ix_(rows, rows)] = drift.covariance[np.ix_(columns, columns)]
    return Uncertainty(parameters=known.parameters, covariance=(covariance + covariance.T) / 2.0)
