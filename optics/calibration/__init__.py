"""Calibration of a layout from frames of a board."""
