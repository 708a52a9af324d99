"""Features of light fields: keypoints with slope and place that all views agree on."""

from optics.light_field.features.detect import DetectorName
from optics.light_field.features.features import FeatureFinder, Features

__all__ = ["DetectorName", "FeatureFinder", "Features"]
