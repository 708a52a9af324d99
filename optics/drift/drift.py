"""Detection of mirrors that rotated or shifted since the calibration: forward selection by likelihood-ratio tests.

Under the null hypothesis, errors of the calibration (its covariance), small motions of every mirror (FLOOR_DEG,
FLOOR_MM) and any common motion of all mirrors explain the matched points. Under the alternative, one mirror also moved
freely. The mirror with the largest likelihood ratio counts as moved if its ratio exceeds a threshold that gives at most
one false alarm in RECORDINGS recordings; then the others are tested again. As the size of the motion is unknown, the
likelihood is averaged over sizes. By Markov's inequality, this ratio exceeds x with a probability of at most 1 / x.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.calibration_result import tilted_to
from mirrorcam.optics.drift.matched_points import IntArray, MatchedPoints
from mirrorcam.optics.drift.mirror_motions import (
    COMMON_DEG,
    all_centre_rows,
    calibration_covariance,
    centre_changes,
    centre_rows,
    common_covariance,
    common_motions,
    covariance_of_centres,
    hinged_covariance,
    motion_covariance,
    rotation_jacobian,
)
from mirrorcam.optics.drift.scene_fit import SceneFit, SceneInformation, parameter_names
from mirrorcam.optics.geometry.layout import Layout, Uncertainty

MIN_MIRRORS = 3
"""With two mirrors, a rotation of one cannot be distinguished from a rotation of the camera in front of both."""
RECORDINGS = 10_000
"""At most one false alarm in this many recordings without drift."""
FLOOR_DEG, FLOOR_MM = 0.001, 0.006
"""Standard deviations of motions that do not count as drift: holders bend by this much, and matching has common errors
of some hundredths of a pixel."""
MOVED_DEG, MOVED_MM = 1.0, 1.0
"""Standard deviations of the rotation and the shift of a mirror that moved."""
ROTATION_SIGMAS_DEG = np.geomspace(0.005, 5.0, 13).tolist()
"""Standard deviations of rotations over which the likelihood is averaged."""
TARGET_DEG = 0.02
"""A rotation that the test should detect."""
DETECTION_SIGMAS = 1.64
"""Rotations that exceed the threshold by this many standard deviations are detected in 19 of 20 recordings."""
MIN_POINTS = 30
"""Minimum number of points in a mirror for a test."""
MAX_SIGMA_PX = 0.2
"""Maximum scatter of a frame's matches after fitting the motions of mirrors; larger scatter means wrong matches."""
UNDETERMINED_DEG = 90.0
MIN_EXPLAINED = 0.25
"""Minimum fraction of a frame's textured corners that other views show if the frame matches the layout."""


def can_test_drift(layout: Layout) -> bool:
    """Whether a layout can be tested for drift: its mirrors were measured, and there are at least MIN_MIRRORS."""
    return layout.kind != "nominal" and len(layout.mirrors) >= MIN_MIRRORS


@dataclass(frozen=True)
class MirrorMove:
    """The estimated motion of one mirror.

    Attributes
    ----------
    index
        Index of the mirror.
    rotation_deg
        Rotation vector (3,) in the rig frame, without the rotation about the normal.
    shift_mm
        Shift along the normal, towards the pupil.
    rotation_sigma_deg
        Standard deviation of the rotation in its worst direction.
    statistic
        Logarithm of the likelihood ratio, in units of the threshold.
    detectable_deg
        Rotation that is detected in 19 of 20 recordings, whatever its direction.
    points
        Number of points that the mirror shows.
    moved
        Whether the mirror moved.
    """

    index: int
    rotation_deg: FloatArray
    shift_mm: float
    rotation_sigma_deg: float
    statistic: float
    detectable_deg: float
    points: int
    moved: bool

    @property
    def tested(self) -> bool:
        """Whether the mirror shows enough points for its other values to be meaningful."""
        return self.detectable_deg < UNDETERMINED_DEG

    @property
    def angle_deg(self) -> float:
        """The rotation's angle."""
        return float(np.linalg.norm(self.rotation_deg))


@dataclass(frozen=True)
class Drift:
    """The motions of the mirrors estimated from a recording.

    Attributes
    ----------
    mirrors
        Motion of each mirror.
    names
        Names (g,) of the parameters.
    change
        Changes (g,) of the parameters of the moved mirrors.
    covariance
        Covariance (g, g) of the parameters after these changes.
    common_rotation_deg, common_rotation_sigma_deg
        Rotation vector (3,) in the rig frame of all mirrors together, and its standard deviations; poorly observable.
    frames, points
        Number of frames, and of the points matched in them.
    sigma_px
        Standard deviation of a match, per axis.
    mismatched
        Whether most frames have detail that does not match this layout: few of their textured corners are found in
        other views, or no motion of mirrors explains the matches.
    """

    mirrors: tuple[MirrorMove, ...]
    names: tuple[str, ...]
    change: FloatArray
    covariance: FloatArray
    common_rotation_deg: FloatArray
    common_rotation_sigma_deg: FloatArray
    frames: int
    points: int
    sigma_px: float
    mismatched: bool = False

    @property
    def moved(self) -> tuple[MirrorMove, ...]:
        """The mirrors that moved."""
        return tuple(mirror for mirror in self.mirrors if mirror.moved)

    @property
    def undetermined(self) -> tuple[MirrorMove, ...]:
        """The mirrors that show too few points to detect a rotation of TARGET_DEG."""
        return tuple(mirror for mirror in self.mirrors if mirror.detectable_deg > TARGET_DEG)


def find_drift(layout: Layout, matches: MatchedPoints) -> Drift:
    """Test the mirrors of a calibrated layout for drift with points matched between its views."""
    names, mirrors = parameter_names(layout), layout.mirrors
    points = np.bincount(matches.view, minlength=len(mirrors))
    if (points >= MIN_POINTS).sum() < 2:
        return _undetermined(layout, names, points.tolist(), matches)
    calibrated, common = calibration_covariance(layout, names), common_covariance(layout, names)
    small = covariance_of_centres(
        {k: motion_covariance(mirror, FLOOR_DEG, FLOOR_MM) for k, mirror in enumerate(mirrors)}, names
    )
    large = covariance_of_centres(
        {k: motion_covariance(mirror, MOVED_DEG, MOVED_MM) for k, mirror in enumerate(mirrors)}, names
    )
    prior = calibrated + common + small + large
    matches = explained_matches(layout, matches, prior)
    points = np.bincount(matches.view, minlength=len(mirrors))
    if (points >= MIN_POINTS).sum() < 2:
        return _undetermined(layout, names, points.tolist(), matches)
    scene = SceneFit(layout, matches, prior).solve()
    information, gradient = deflated(scene)
    return _Test(layout, names, scene, information, gradient, calibrated, small, common).run()


def explained_matches(layout: Layout, matches: MatchedPoints, prior: FloatArray) -> MatchedPoints:
    """The points of frames whose matches can be explained by motions of the mirrors; others have wrong matches."""
    is_explained = np.zeros(len(matches.point), dtype=bool)
    for frame in np.unique(matches.frame):
        rows = matches.frame[matches.point] == frame
        is_explained[rows] = SceneFit(layout, matches.where(rows), prior).solve().sigma_px <= MAX_SIGMA_PX
    return matches.where(is_explained)


def _undetermined(layout: Layout, names: tuple[str, ...], points: list[int], matches: MatchedPoints) -> Drift:
    """The result for too few points."""
    mirrors = tuple(
        MirrorMove(k, np.zeros(3), 0.0, MOVED_DEG, 0.0, UNDETERMINED_DEG, count, moved=False)
        for k, count in enumerate(points)
    )
    return Drift(
        mirrors=mirrors,
        names=names,
        change=np.zeros(len(names)),
        covariance=calibration_covariance(layout, names),
        common_rotation_deg=np.zeros(3),
        common_rotation_sigma_deg=np.full(3, COMMON_DEG),
        frames=0,
        points=len(matches.frame),
        sigma_px=0.0,
        mismatched=_mismatched(matches),
    )


def _mismatched(matches: MatchedPoints) -> bool:
    """Whether most frames have few explained matches in comparison with their textured corners."""
    explained = np.bincount(matches.frame, minlength=len(matches.textured))
    mismatched = (matches.textured >= MIN_POINTS) & (explained < MIN_EXPLAINED * matches.textured)
    return bool(2 * mismatched.sum() > len(mismatched))


def deflated(scene: SceneInformation) -> tuple[FloatArray, FloatArray]:
    """Information H and score h, divided by the variance inflation estimated from the scatter of sums over cells.

    It accounts for correlated errors of neighbouring points.
    """
    scale = np.sqrt(np.maximum(np.diag(scene.information), 1e-300))
    values, vectors = np.linalg.eigh(scene.information / np.outer(scale, scale))
    regular = values > 1e-6 * values[-1]
    whitening = (vectors[:, regular] / np.sqrt(values[regular])).T / scale
    inflation = max(1.0, float(np.trace(whitening @ scene.scatter @ whitening.T)) / int(regular.sum()))
    return scene.information / inflation, scene.gradient / inflation


@dataclass(frozen=True)
class _Marginal:
    """Score (I + H C)^-1 h and information (I + H C)^-1 H, marginalised over changes with the prior covariance C."""

    score: FloatArray
    information: FloatArray

    def ratio_statistic(self, rows: IntArray, block: FloatArray) -> float:
        """Twice the log-likelihood ratio of a further motion of parameters `rows` with covariance `block` (3, 3)."""
        system = np.eye(3) + self.information[np.ix_(rows, rows)] @ block
        score = self.score[rows]
        return float(score @ block @ np.linalg.solve(system, score) - np.linalg.slogdet(system)[1])


@dataclass(frozen=True)
class _Test:
    """A test: information H and score h of the changes, and their prior covariances (g, g) without drift."""

    layout: Layout
    names: tuple[str, ...]
    scene: SceneInformation
    information: FloatArray
    gradient: FloatArray
    calibrated: FloatArray
    small: FloatArray
    common: FloatArray

    def run(self) -> Drift:
        """Add moved mirrors until the largest likelihood ratio is below the threshold."""
        moved_blocks: dict[int, FloatArray] = {}
        statistics = dict.fromkeys(range(len(self.layout.mirrors)), 0.0)
        tested = [k for k in range(len(self.layout.mirrors)) if self.scene.point_counts[k] >= MIN_POINTS]
        while len(moved_blocks) < len(tested) - 1:
            marginal = self._marginal(moved_blocks)
            candidates = [k for k in tested if k not in moved_blocks]
            statistics |= {k: self._mean_statistic(marginal, k) for k in candidates}
            best = max(candidates, key=lambda k: statistics[k])
            if statistics[best] <= self.threshold:
                break
            moved_blocks[best] = self._likeliest(marginal, best)
        marginal, motions = self._marginal(moved_blocks), covariance_of_centres(moved_blocks, self.names)
        rotation, sigma = self._common_rotation(marginal)
        return Drift(
            mirrors=tuple(
                self._move(k, moved_blocks, statistics.get(k, 0.0) / self.threshold)
                for k in range(len(self.layout.mirrors))
            ),
            names=self.names,
            change=motions @ marginal.score,
            covariance=self._covariance(motions),
            common_rotation_deg=rotation,
            common_rotation_sigma_deg=sigma,
            frames=self.scene.frames,
            points=self.scene.points,
            sigma_px=self.scene.sigma_px,
        )

    @property
    def threshold(self) -> float:
        """Threshold for twice the log-likelihood ratio: at most one false alarm in RECORDINGS recordings."""
        return 2.0 * float(np.log(RECORDINGS * len(self.layout.mirrors)))

    def _marginal(self, moved_blocks: dict[int, FloatArray]) -> _Marginal:
        """Score and information, given that some mirrors may have moved with prior covariances (3, 3)."""
        prior = self.calibrated + self.small + self.common + covariance_of_centres(moved_blocks, self.names)
        system = np.eye(len(prior)) + self.information @ prior
        solution = np.linalg.solve(system, np.column_stack([self.gradient, self.information]))
        return _Marginal(np.asarray(solution[:, 0], np.float64), np.asarray(solution[:, 1:], np.float64))

    def _mean_statistic(self, marginal: _Marginal, k: int) -> float:
        """Twice the logarithm of the likelihood ratio for a moved mirror, averaged over ROTATION_SIGMAS_DEG."""
        rows = centre_rows(self.names, k)
        statistics = np.array(
            [
                marginal.ratio_statistic(rows, hinged_covariance(self.layout.mirrors[k], sigma))
                for sigma in ROTATION_SIGMAS_DEG
            ]
        )
        return 2.0 * float(logsumexp(statistics / 2.0) - np.log(len(statistics)))

    def _likeliest(self, marginal: _Marginal, k: int) -> FloatArray:
        """The prior covariance (3, 3) of a mirror's motion with the largest likelihood (empirical Bayes).

        Over a short range of depths, points hardly distinguish a rotation from a shift; this prior bounds the shift by
        the rotation.
        """
        rows = centre_rows(self.names, k)
        motions = [hinged_covariance(self.layout.mirrors[k], sigma) for sigma in ROTATION_SIGMAS_DEG]
        return max(motions, key=lambda block: marginal.ratio_statistic(rows, block))

    def _common_rotation(self, marginal: _Marginal) -> tuple[FloatArray, FloatArray]:
        """Rotation vector (3,) of all mirrors together, and standard deviations (3,), deg."""
        motions, rows = common_motions(self.layout), all_centre_rows(self.layout, self.names)
        covariance = np.eye(motions.shape[1]) - motions.T @ marginal.information[np.ix_(rows, rows)] @ motions
        common = motions.T @ marginal.score[rows]
        return COMMON_DEG * common[:3], COMMON_DEG * np.sqrt(np.maximum(np.diag(covariance)[:3], 0.0))

    def _move(self, k: int, moved_blocks: dict[int, FloatArray], statistic: float) -> MirrorMove:
        """The motion of one mirror, given priors for it and for the mirrors found to have moved."""
        without_mirror = self._marginal({m: block for m, block in moved_blocks.items() if m != k})
        block = moved_blocks[k] if k in moved_blocks else self._likeliest(without_mirror, k)
        marginal = self._marginal(moved_blocks | {k: block})
        rows, mirror = centre_rows(self.names, k), self.layout.mirrors[k]
        d_centre = rotation_jacobian(self.layout, self.names, k)[:, rows]
        change = block @ marginal.score[rows]
        covariance = d_centre @ (block - block @ marginal.information[np.ix_(rows, rows)] @ block) @ d_centre.T
        return MirrorMove(
            index=k,
            rotation_deg=np.degrees(d_centre @ change),
            shift_mm=float(mirror.normal_in_rig @ change) / 2.0,
            rotation_sigma_deg=float(np.degrees(np.sqrt(max(np.linalg.eigvalsh(covariance)[-1], 0.0)))),
            statistic=statistic,
            detectable_deg=self._detectable_deg(without_mirror, k),
            points=int(self.scene.point_counts[k]),
            moved=k in moved_blocks,
        )

    def _detectable_deg(self, marginal: _Marginal, k: int) -> float:
        """The rotation about a mirror's centre that is detected in 19 of 20 recordings, in the worst direction.

        Chi squared grows by `rate` per squared rotation; averaging over sizes of motion raises the threshold.
        """
        rows, mirror = centre_rows(self.names, k), self.layout.mirrors[k]
        changes = np.linalg.svd(mirror.normal_in_rig[None])[2][1:] @ centre_changes(mirror)
        rate = float(np.linalg.eigvalsh(changes @ marginal.information[np.ix_(rows, rows)] @ changes.T)[0])
        if self.scene.point_counts[k] < MIN_POINTS or rate <= 0.0:
            return UNDETERMINED_DEG
        raised_threshold = self.threshold + 3.0 * np.log(self.threshold) + 2.0 * np.log(len(ROTATION_SIGMAS_DEG))
        return min(float(np.degrees((np.sqrt(raised_threshold) + DETECTION_SIGMAS) / np.sqrt(rate))), UNDETERMINED_DEG)

    def _covariance(self, motions: FloatArray) -> FloatArray:
        """Covariance of the parameters once the moved mirrors' changes are applied (Joseph form)."""
        identity = np.eye(len(motions))
        prior = self.calibrated + self.small + self.common + motions
        kalman_gain = motions @ np.linalg.inv(identity + self.information @ prior)
        residual = identity - kalman_gain @ self.information
        # Small motions of other mirrors propagate into the moved mirrors, as noise does.
        noise = self.information + self.information @ self.small @ self.information
        return np.asarray(residual @ (self.calibrated + motions) @ residual.T + kalman_gain @ noise @ kalman_gain.T)


def drift_corrected_layout(layout: Layout, drift: Drift, source: str) -> Layout:
    """The layout with the planes and covariance of the moved mirrors updated, and its provenance.

    Other mirrors and the camera remain as calibrated. `source` names the recording.
    """
    mirrors = list(layout.mirrors)
    for move in drift.moved:
        mirror = mirrors[move.index]
        change = drift.change[centre_rows(drift.names, move.index)]
        mirrors[move.index] = tilted_to(mirror, mirror.virtual_centre_in_rig_mm + change)
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
    """The covariance of the calibrated parameters, updated for the moved mirrors; None if the layout has none."""
    prior = layout.uncertainty
    if prior is None:
        return None
    pairs = [(index, drift.names.index(name)) for index, name in enumerate(prior.parameters) if name in drift.names]
    rows, columns = np.array(pairs, dtype=np.int64).T
    covariance = prior.covariance.copy()
    covariance[np.ix_(rows, rows)] = drift.covariance[np.ix_(columns, columns)]
    return Uncertainty(parameters=prior.parameters, covariance=(covariance + covariance.T) / 2.0)
