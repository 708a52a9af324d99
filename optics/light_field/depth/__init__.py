"""Metric depth of the reference view from all views of a light field."""

from mirrorcam.optics.light_field.depth.depth_map import DepthMap as DepthMap
from mirrorcam.optics.light_field.depth.estimate import DepthEstimator as DepthEstimator
from mirrorcam.optics.light_field.depth.estimate import Quality as Quality
from mirrorcam.optics.light_field.depth.estimate import estimate_depth as estimate_depth
from mirrorcam.optics.light_field.depth.video import VideoDepth as VideoDepth
