"""Finite elements of the device: motions of its mirrors relative to the camera by gravity, temperature and creep."""
