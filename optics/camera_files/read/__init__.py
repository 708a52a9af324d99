"""Readers of calibrations in the files of other tools, each as a `CameraRig`."""
