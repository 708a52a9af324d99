"""Readers and writers of still pictures, which check what they read before they decode it."""
