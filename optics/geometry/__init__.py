"""Camera, mirrors and layout, and where light goes between them."""
