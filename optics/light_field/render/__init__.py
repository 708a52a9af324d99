"""Pictures made of light fields: refocused, from other places, epipolar-plane images."""
