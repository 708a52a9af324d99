"""Calibration without a layout, of a camera that sees a board both directly and in its mirrors."""
