"""Calibration boards: their print and their motion."""
