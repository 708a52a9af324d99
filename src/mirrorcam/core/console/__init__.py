"""The terminal: progress, messages, options and refusals."""
