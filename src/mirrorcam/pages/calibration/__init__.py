"""The report of a calibration: its verdict and the diagnostics behind it."""
