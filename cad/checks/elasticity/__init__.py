"""Finite elements of the whole device: how gravity, warmth and creep move its mirrors against the camera."""
