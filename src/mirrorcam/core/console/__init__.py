"""The terminal: progress, messages, and the texts of options."""
