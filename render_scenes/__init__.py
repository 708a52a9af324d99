"""Synthetic frames of a layout, with ground truth in a folder of its own."""
