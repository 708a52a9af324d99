"""Readers of calibrations in the formats of other tools; each returns a `CameraRig`."""
