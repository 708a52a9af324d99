"""How sure a calibration is, and whether its model is right."""
