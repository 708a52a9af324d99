"""Whether mirrors turned or shifted since the calibration: a likelihood-ratio test of each mirror, one after another.

Under the null hypothesis, errors of the calibration (its covariance), small motions of every mirror (FLOOR_DEG,
FLOOR_MM) and any common motion of all mirrors explain what is seen. Against it, one mirror may have moved freely. The
mirror that gains most is taken to have moved, if it gains more than chance gives in one recording of RECORDINGS, and
the others are tested again.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.mirror_uncertainty import rigid_motions
from mirrorcam.optics.drift.matched_points import IntArray, MatchedPoints
from mirrorcam.optics.drift.scene_fit import SceneFit, SceneTells, parameter_names
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror

RECORDINGS = 10_000
"""One false alarm in so many recordings where nothing moved, at most."""
FLOOR_DEG, FLOOR_MM = 0.0015, 0.01
"""Standard deviations of what is no drift: matching has common errors of some hundredths of a pixel, and no holder is
stiffer."""
WIDE_DEG, WIDE_MM = 1.0, 1.0
"""Standard deviations of the turn and the shift of a mirror that moved."""
TURNS_DEG = np.geomspace(0.005, 5.0, 13).tolist()
"""Sizes of turns that are tried for the standard deviation of a mirror that moved."""
COMMON_DEG, COMMON_MM, COMMON_SCALE = 0.5, 0.5, 0.01
"""Standard deviations of the motion of all mirrors together, which a scene hardly tells."""
WANTED_DEG = 0.02
"""A turn that the test is to tell."""
MISSED = 1.64
"""Turns of this many standard deviations beyond the threshold are told in 19 of 20 recordings."""
LEAST_POINTS = 30
"""A mirror that shows fewer points is not tested."""
UNTOLD_DEG = 90.0


@dataclass(frozen=True)
class MirrorMove:
    """What the pictures tell of one mirror.

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
        Gain of letting the mirror move, in units of the threshold.
    tells_deg
        Turns of this size are told in 19 of 20 recordings, whatever their direction.
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
    def size_deg(self) -> float:
        """The turn's angle."""
        return float(np.linalg.norm(self.turn_deg))


@dataclass(frozen=True)
class Drift:
    """What a recording tells of the mirrors.

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

    @property
    def moved(self) -> tuple[MirrorMove, ...]:
        """The mirrors that moved."""
        return tuple(mirror for mirror in self.mirrors if mirror.moved)

    @property
    def untold(self) -> tuple[MirrorMove, ...]:
        """The mirrors of which the pictures show too little to tell a turn of WANTED_DEG."""
        return tuple(mirror for mirror in self.mirrors if mirror.tells_deg > WANTED_DEG)


def find_drift(layout: Layout, matches: MatchedPoints) -> Drift:
    """Test the mirrors of a calibrated layout by points that its views show."""
    names, frames = parameter_names(layout), len(np.unique(matches.frame))
    shown = np.bincount(matches.view, minlength=len(layout.mirrors))
    if (shown >= LEAST_POINTS).sum() < 2:
        return _nothing(layout, names, shown.tolist(), len(matches.frame))
    calibrated, common = calibration_covariance(layout, names), common_covariance(layout, names)
    null = calibrated + common + sum(_own(layout, names, k, FLOOR_DEG, FLOOR_MM) for k in range(len(layout.mirrors)))
    wide = [_own(layout, names, k, WIDE_DEG, WIDE_MM) for k in range(len(layout.mirrors))]
    told = SceneFit(layout, matches, null + sum(wide)).solve()
    information, h = _deflated(told)
    return _Test(layout, names, told, information, h, null, common, wide).run(frames)


def _nothing(layout: Layout, names: tuple[str, ...], shown: list[int], points: int) -> Drift:
    """What too few points tell."""
    mirrors = tuple(
        MirrorMove(k, np.zeros(3), 0.0, WIDE_DEG, 0.0, UNTOLD_DEG, count, False) for k, count in enumerate(shown)
    )
    return Drift(
        mirrors=mirrors,
        names=names,
        change=np.zeros(len(names)),
        covariance=calibration_covariance(layout, names),
        common_turn_deg=np.zeros(3),
        common_turn_sigma_deg=np.full(3, COMMON_DEG),
        frames=0,
        points=points,
        sigma_px=0.0,
    )


def _deflated(told: SceneTells) -> tuple[FloatArray, FloatArray]:
    """H and h, less as errors of neighbouring points are alike: by how the sums over cells scatter."""
    values, vectors = np.linalg.eigh(_scaled(told.information))
    kept = values > 1e-6 * values[-1]
    root = np.sqrt(np.maximum(np.diag(told.information), 1e-300))
    white = (vectors[:, kept] / np.sqrt(values[kept])).T / root
    inflation = max(1.0, float(np.trace(white @ told.scatter @ white.T)) / int(kept.sum()))
    return told.information / inflation, told.gradient / inflation


def _scaled(matrix: FloatArray) -> FloatArray:
    root = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    return np.asarray(matrix / np.outer(root, root))


@dataclass(frozen=True)
class _Test:
    layout: Layout
    names: tuple[str, ...]
    told: SceneTells
    information: FloatArray
    gradient: FloatArray
    null: FloatArray
    common: FloatArray
    wide: list[FloatArray]

    def run(self, frames: int) -> Drift:
        """Let mirrors move as long as one gains more than chance gives."""
        count = len(self.wide)
        limit = float(chi2.isf(1.0 / (RECORDINGS * count), 3))
        moved: list[int] = []
        statistics = np.zeros(count)
        tested = [k for k in range(count) if self.told.seen[k] >= LEAST_POINTS]
        while len(moved) < len(tested) - 1:
            gains = {k: self._gain(moved, k) for k in tested if k not in moved}
            for k, gain in gains.items():
                statistics[k] = gain
            best = max(gains, key=lambda k: gains[k])
            if gains[best] <= limit:
                break
            moved.append(best)
        own: dict[int, FloatArray] = {}
        for k in moved:
            others = [self.wide[m] if m not in own else own[m] for m in moved if m != k]
            own[k] = self._likely(self.null + sum(others, start=np.zeros_like(self.null)), k)
        free = self.null + sum(own.values(), start=np.zeros_like(self.null))
        change = sum(own.values(), start=np.zeros_like(free)) @ self._pulled(free)
        turn, sigma = self._common_turn(free)
        return Drift(
            mirrors=tuple(self._move(k, own, free, float(statistics[k]), limit) for k in range(count)),
            names=self.names,
            change=change,
            covariance=self._covariance(own, free),
            common_turn_deg=turn,
            common_turn_sigma_deg=sigma,
            frames=frames,
            points=self.told.points,
            sigma_px=self.told.sigma_px,
        )

    def _common_turn(self, prior: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rotation vector (3,) of all mirrors together, and standard deviations (3,), deg."""
        motions, rows = _common_motions(self.layout), _all_rows(self.layout, self.names)
        inside = np.linalg.solve(np.eye(len(prior)) + self.information @ prior, self.information)
        spread = np.eye(motions.shape[1]) - motions.T @ inside[np.ix_(rows, rows)] @ motions
        found = motions.T @ self._pulled(prior)[rows]
        return COMMON_DEG * found[:3], COMMON_DEG * np.sqrt(np.maximum(np.diag(spread)[:3], 0.0))

    def _pulled(self, prior: FloatArray) -> FloatArray:
        """What a prior covariance is to be multiplied with, for the changes that the pictures tell under it."""
        return np.asarray(np.linalg.solve(np.eye(len(prior)) + self.information @ prior, self.gradient))

    def _likely(self, others: FloatArray, k: int) -> FloatArray:
        """The prior of a mirror's motion under which the pictures are most likely (empirical Bayes).

        A mirror turns about a point of it or near it, so that its middle shifts by about its half size times the turn:
        over a short range of depths, pictures tell the two hardly apart.
        """
        mirror = self.layout.mirrors[k]
        spokes = mirror.outline_in_rig_mm - mirror.outline_in_rig_mm.mean(axis=0)
        half_mm = float(np.linalg.norm(spokes, axis=1).mean())
        priors = [_own(self.layout, self.names, k, turn, half_mm * np.deg2rad(turn)) for turn in TURNS_DEG]

        def evidence(prior: FloatArray) -> float:
            whole = others + prior
            spread = np.linalg.slogdet(np.eye(len(whole)) + self.information @ whole)[1]
            return float(self._cost(whole) - spread)

        return max(priors, key=evidence)

    def _cost(self, prior: FloatArray) -> float:
        """What changes of this prior covariance explain of chi squared."""
        return float(self.gradient @ prior @ self._pulled(prior))

    def _gain(self, moved: list[int], k: int) -> float:
        prior = self.null + sum((self.wide[m] for m in moved), start=np.zeros_like(self.null))
        return self._cost(prior + self.wide[k]) - self._cost(prior)

    def _move(self, k: int, own: dict[int, FloatArray], free: FloatArray, gain: float, limit: float) -> MirrorMove:
        """The figures of one mirror; its uncertainty is that of a mirror that may move, with the others as they are."""
        mine = own[k] if k in own else self._likely(free, k)
        prior = free if k in own else free + mine
        without = prior - mine
        by_turn, rows = turn_of_centre(self.layout, self.names, k), mirror_rows(self.names, k)
        posterior = prior @ np.linalg.inv(np.eye(len(prior)) + self.information @ prior)
        sigma = np.sqrt(max(float(np.linalg.eigvalsh(by_turn @ posterior @ by_turn.T)[-1]), 0.0))
        change = mine @ self._pulled(prior)
        mirror = self.layout.mirrors[k]
        # By how much chi squared gains, in the mean, per squared turn about the mirror's middle: noncentrality.
        turns = _turns_about_middle(mirror)
        stays = (self.information @ np.linalg.inv(np.eye(len(without)) + without @ self.information))[
            np.ix_(rows, rows)
        ]
        across = np.linalg.svd(mirror.normal_in_rig[None])[2][1:]
        least = float(np.linalg.eigvalsh(across @ turns @ stays @ turns.T @ across.T)[0])
        return MirrorMove(
            index=k,
            turn_deg=np.degrees(by_turn @ change),
            shift_mm=float(mirror.normal_in_rig @ change[rows]) / 2.0,
            turn_sigma_deg=float(np.degrees(sigma)),
            statistic=gain / limit,
            tells_deg=self._tells_deg(k, least, limit),
            points=int(self.told.seen[k]),
            moved=k in own,
        )

    def _tells_deg(self, k: int, least: float, limit: float) -> float:
        """The turn that is told from the noncentrality per squared turn in the worst direction."""
        if self.told.seen[k] < LEAST_POINTS or least <= 0.0:
            return UNTOLD_DEG
        return min(float(np.degrees((np.sqrt(limit) + MISSED) / np.sqrt(least))), UNTOLD_DEG)

    def _covariance(self, moves: dict[int, FloatArray], free: FloatArray) -> FloatArray:
        """Covariance of the parameters once the moved mirrors' changes are applied (Joseph's form)."""
        calibrated = calibration_covariance(self.layout, self.names)
        own = sum(moves.values(), start=np.zeros_like(free))
        applied = own @ np.linalg.inv(np.eye(len(free)) + self.information @ free)
        left = np.eye(len(free)) - applied @ self.information
        # What no drift is of the others passes into the moved mirrors, as the noise does.
        others = self.information @ (self.null - self.common - calibrated) @ self.information
        return left @ (calibrated + own) @ left.T + applied @ (self.information + others) @ applied.T


def mirror_rows(names: tuple[str, ...], k: int) -> IntArray:
    """Places (3,) of a mirror's virtual centre among the parameters."""
    return np.array([names.index(f"mirror {k} {axis}_mm") for axis in "xyz"])


def turn_of_centre(layout: Layout, names: tuple[str, ...], k: int) -> FloatArray:
    """Derivatives (3, g) of a mirror's turn, rad: c = -2 d n, so that dn = -dc / |c| across n, and w = n x dn."""
    mirror = layout.mirrors[k]
    n = mirror.normal_in_rig
    skew = np.array([[0.0, -n[2], n[1]], [n[2], 0.0, -n[0]], [-n[1], n[0], 0.0]])
    turn = np.zeros((3, len(names)))
    turn[:, mirror_rows(names, k)] = -skew / (2.0 * mirror.distance_mm)
    return turn


def _turns_about_middle(mirror: Mirror) -> FloatArray:
    """Changes (3, 3) of the virtual centre, mm per rad, row by row for turns about the rig's axes at the middle."""
    n, middle = mirror.normal_in_rig, mirror.outline_in_rig_mm.mean(axis=0)
    return np.array(
        [-2.0 * (axis @ np.cross(middle, n) * n + mirror.distance_mm * np.cross(axis, n)) for axis in np.eye(3)]
    )


def _own(layout: Layout, names: tuple[str, ...], k: int, turn_deg: float, shift_mm: float) -> FloatArray:
    """Covariance (g, g) of a mirror that turns and shifts by itself about the middle of its outline."""
    n, turns = layout.mirrors[k].normal_in_rig, _turns_about_middle(layout.mirrors[k])
    block = np.deg2rad(turn_deg) ** 2 * turns.T @ turns + (2.0 * shift_mm) ** 2 * np.outer(n, n)
    covariance = np.zeros((len(names),) * 2)
    rows = mirror_rows(names, k)
    covariance[np.ix_(rows, rows)] = block
    return covariance


def common_covariance(layout: Layout, names: tuple[str, ...]) -> FloatArray:
    """Covariance (g, g) of motions of all mirrors as one body, and of a common scale of all, which no picture tells."""
    motions, rows = _common_motions(layout), _all_rows(layout, names)
    covariance = np.zeros((len(names),) * 2)
    covariance[np.ix_(rows, rows)] = motions @ motions.T
    return covariance


def _common_motions(layout: Layout) -> FloatArray:
    """Changes (3 m, 7) of the virtual centres by a standard deviation of each common motion and of the scale."""
    sizes = np.array([np.deg2rad(COMMON_DEG)] * 3 + [COMMON_MM] * 3)
    centres = np.array([mirror.virtual_centre_in_rig_mm for mirror in layout.mirrors])
    return np.column_stack([rigid_motions(layout) * sizes, COMMON_SCALE * centres.ravel()])


def _all_rows(layout: Layout, names: tuple[str, ...]) -> IntArray:
    return np.concatenate([mirror_rows(names, k) for k in range(len(layout.mirrors))])


def calibration_covariance(layout: Layout, names: tuple[str, ...]) -> FloatArray:
    """Covariance (g, g) that the calibration states; 0 of what it does not state."""
    covariance = np.zeros((len(names),) * 2)
    known = layout.uncertainty
    if known is not None:
        pairs = [(names.index(name), place) for place, name in enumerate(known.parameters) if name in names]
        rows, places = np.array(pairs, dtype=np.int64).T
        covariance[np.ix_(rows, rows)] = known.covariance[np.ix_(places, places)]
    return covariance
