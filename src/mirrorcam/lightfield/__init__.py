"""The commands from frames to views, depth and features."""
