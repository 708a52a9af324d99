"""The mirror holder: a seat for every mirror, out of the light."""
