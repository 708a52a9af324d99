"""A tabletop scene with the ground truth of its light field."""
