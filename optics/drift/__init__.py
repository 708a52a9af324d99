"""Whether mirrors moved since the calibration, told from pictures of any scene."""
