"""Synthetic frames of a layout, with sealed truth."""
