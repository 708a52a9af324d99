"""Lens models: how a lens bends the normalized coordinates of a ray, each family in a module of its own."""
