"""Suites, scores and the leaderboard of calibrators."""
