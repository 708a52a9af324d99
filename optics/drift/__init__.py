"""Whether mirrors moved since the calibration, measured by pictures of any scene."""
