"""Scenes that are hard for depth estimation, viewed by an even grid of pinholes, with true disparity."""
