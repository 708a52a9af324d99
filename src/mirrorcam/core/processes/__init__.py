"""Worker processes, child programs, and what ends them."""
