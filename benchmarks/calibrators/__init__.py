"""Calibrators to be scored, built from other tools as a user would: they read a set, never its ground truth."""
