"""Calibrators that are made of OpenCV's functions as a user would, to be scored: they see a set, never its truth."""
