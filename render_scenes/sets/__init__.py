"""Calibration sets: poses, frames, sensor, files."""
