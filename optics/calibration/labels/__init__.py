"""Calibration of mirrors from labelled points of an animal, without a board."""
