"""Synthetic frames of a layout, with ground truth in a separate folder."""
