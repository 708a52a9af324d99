"""Frames of video files, streams and cameras, and writers of video."""
