"""A page of one decoded frame, for a first look without a camera."""
