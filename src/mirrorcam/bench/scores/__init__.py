"""Scores of anyone's calibration of a device whose true layout is known."""
