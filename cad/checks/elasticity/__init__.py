"""Finite elements of the device: motions of its mirrors relative to the camera under gravity, heat and creep."""
