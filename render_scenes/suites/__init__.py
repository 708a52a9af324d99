"""Suites: named, versioned lists of sets, each of which follows from its recipe."""
