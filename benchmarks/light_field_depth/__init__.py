"""Depth of light fields beside OpenCV's stereo, beside the truth, and its speed."""
