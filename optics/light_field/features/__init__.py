"""Features of light fields: keypoints with a slope and a position on which all views agree."""

from mirrorcam.optics.light_field.features.feature_set import Features
from mirrorcam.optics.light_field.features.keypoints import DetectorName
from mirrorcam.optics.light_field.features.light_field_features import FeatureDetector, FeatureFinder

__all__ = ["DetectorName", "FeatureDetector", "FeatureFinder", "Features"]
