"""Scenes that are hard for depth estimation, seen by an even grid of pinholes, with true disparity."""
