"""How sure a calibration is, and whether its model is right: `climb` fits it, `gather` tells all there is to tell."""
