"""The renderer by formula, for large sets."""
