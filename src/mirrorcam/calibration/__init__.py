"""The commands calibrate, compare, drift and validate, with their figures and page."""
