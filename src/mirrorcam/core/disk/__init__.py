"""Files and folders: atomic writes, ownership, and results that are kept."""
