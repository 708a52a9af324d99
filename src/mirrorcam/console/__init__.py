"""Progress of long work on a terminal, and its interruption."""
