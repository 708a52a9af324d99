"""Camera, mirrors and layout, and the paths of light between them."""
