"""The rigid motion between two sets of points of which some are wrong: closed form within RANSAC.

Horn, "Closed-form solution of absolute orientation using unit quaternions", JOSA A 1987, by the singular value
decomposition of Umeyama, PAMI 1991; Fischler and Bolles, "Random sample consensus", CACM 1981.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.transforms import rigid, transform

TRIALS = 256
SAMPLE = 3
LEAST_INLIERS = 8


def rigid_motions(src: FloatArray, dst: FloatArray, weights: FloatArray) -> FloatArray:
    """Transforms dst_from_src (..., 4, 4) of points (..., n, 3) with the least weighted squared distances."""
    share = weights / weights.sum(axis=-1, keepdims=True)
    centres = [(share[..., None] * points).sum(axis=-2) for points in (src, dst)]
    away = [points - centre[..., None, :] for points, centre in zip((src, dst), centres, strict=True)]
    u, _, vt = np.linalg.svd(np.swapaxes(share[..., None] * away[1], -1, -2) @ away[0])
    # No reflection: the direction of which the points tell least turns over.
    u[..., :, 2] *= np.sign(np.linalg.det(u @ vt))[..., None]
    turn = u @ vt
    return rigid(turn, centres[1] - (turn @ centres[0][..., None])[..., 0])


def robust_motion(
    src: FloatArray, dst: FloatArray, sigmas: FloatArray, seed: int = 0
) -> tuple[FloatArray, NDArray[np.bool_]] | None:
    """Transform dst_from_src (4, 4) of matched points (n, 3), and which of them are inliers; None where too few agree.

    Parameters
    ----------
    src, dst
        Points (n, 3) of either set, the same numbers matched.
    sigmas
        Standard deviations (n, 3) of the differences along the axes of dst.
    seed
        Seed of the samples that are tried.
    """
    if len(src) < LEAST_INLIERS:
        return None
    random = np.random.default_rng(seed)
    chosen = np.stack([random.choice(len(src), SAMPLE, replace=False) for _ in range(TRIALS)])
    weights = 1.0 / (sigmas**2).mean(axis=1)
    tried = rigid_motions(src[chosen], dst[chosen], weights[chosen])
    moved = src @ np.swapaxes(tried[:, :3, :3], -1, -2) + tried[:, None, :3, 3]
    near = (((moved - dst) / sigmas) ** 2).sum(axis=2) < 9.0 * SAMPLE
    inliers = near[near.sum(axis=1).argmax()]
    motion = None
    for _ in range(3):
        if inliers.sum() < LEAST_INLIERS:
            return None
        motion = rigid_motions(src[inliers], dst[inliers], weights[inliers])
        inliers = (((transform(motion, src) - dst) / sigmas) ** 2).sum(axis=1) < 9.0 * SAMPLE
    return None if motion is None or inliers.sum() < LEAST_INLIERS else (motion, inliers)
