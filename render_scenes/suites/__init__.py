"""Suites: named, versioned lists of sets, each with a recipe."""
