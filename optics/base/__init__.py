"""Values that validate themselves, and files that are written atomically."""
