"""The studio: pages for this machine only, to change a design and to watch a live camera."""
