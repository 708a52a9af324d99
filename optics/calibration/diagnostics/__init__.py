"""Uncertainty of a calibration and tests of its model: `select_model` fits, `diagnose` collects the diagnostics."""
