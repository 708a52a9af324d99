"""The page that tells whether a calibration is good to use, and why."""
