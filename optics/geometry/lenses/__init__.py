"""Lens models, which map the normalized coordinates of a ray to distorted ones."""
