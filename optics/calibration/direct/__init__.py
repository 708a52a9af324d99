"""Calibration without a layout, for a camera that sees a board both directly and in its mirrors."""
