"""The commands that make a device: cad, adjust, board, and the camera library."""
