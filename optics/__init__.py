"""Optics of a mirror camera: design, calibration and light field. Imports nothing else of this project."""
