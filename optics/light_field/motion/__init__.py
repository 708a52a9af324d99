"""Motion of the camera from light fields: poses with covariances, frame by frame."""

from mirrorcam.optics.light_field.motion.tracker import LightFieldTracker, TrackedPose, save_json, save_tum

__all__ = ["LightFieldTracker", "TrackedPose", "save_json", "save_tum"]
