"""The studio: pages served on this machine alone, on which a designer changes a design and a camera is watched live."""
