"""Calibration boards as they are printed, and how they move."""
