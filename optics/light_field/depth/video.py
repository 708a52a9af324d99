"""Depth of the frames of a video."""

from __future__ import annotations

from mirrorcam.core.arguments import check_type
from mirrorcam.optics.light_field.depth.depth_map import DepthMap
from mirrorcam.optics.light_field.depth.estimate import DepthEstimator
from mirrorcam.optics.light_field.depth.track import Track
from mirrorcam.optics.light_field.light_field import LightField
from mirrorcam.optics.light_field.temporal import TemporalFilter


class VideoDepth:
    """Depth of the frames of one video, in order, from light fields filtered in time (`TemporalFilter`).

    The first result equals `DepthEstimator.estimate`; later ones also depend on earlier frames.
    """

    def __init__(self, estimator: DepthEstimator) -> None:
        check_type("estimator", estimator, DepthEstimator)
        self._estimator = estimator
        self._filter = TemporalFilter(estimator.workers)
        self._track: Track | None = None

    def estimate(self, light_field: LightField) -> DepthMap:
        """Return the depth of the next frame; raises InputError like `DepthEstimator.estimate`."""
        check_type("light_field", light_field, LightField)
        filtered = self._filter.filtered(light_field)
        changed = self._filter.unaveraged(self._estimator.reference)
        depth, self._track = self._estimator.following(filtered, self._track, changed)
        return depth
