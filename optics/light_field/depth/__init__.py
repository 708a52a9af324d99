"""Metric depth of the reference view from all views of a light field."""

from optics.light_field.depth.depth_map import DepthMap as DepthMap
from optics.light_field.depth.estimate import DepthEstimator as DepthEstimator
