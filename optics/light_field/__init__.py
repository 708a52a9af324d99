"""Decoding of frames to light fields."""
