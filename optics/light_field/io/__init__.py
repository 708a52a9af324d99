"""Light fields and frames as files and streams."""
