"""Pictures rendered from light fields: refocused, from other positions, and epipolar-plane images."""
