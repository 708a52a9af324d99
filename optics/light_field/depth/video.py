"""Depth of videos that is consistent in time: what does not move keeps its depth."""

from __future__ import annotations

from mirrorcam.optics.light_field.depth.depth_map import DepthMap
from mirrorcam.optics.light_field.depth.estimate import DepthEstimator
from mirrorcam.optics.light_field.light_field import LightField
from mirrorcam.optics.light_field.temporal import TemporalFilter


class VideoDepth:
    """Depth of the light fields of one video, filtered in time (`TemporalFilter`), in their order.

    The first is that of `DepthEstimator.estimate`; later ones depend on the frames before, too.
    """

    def __init__(self, estimator: DepthEstimator) -> None:
        self._estimator = estimator
        self._filter = TemporalFilter()

    def estimate(self, light_field: LightField) -> DepthMap:
        """The depth of the next frame; raises InputError as `DepthEstimator.estimate`."""
        return self._estimator.estimate(self._filter.filtered(light_field))
