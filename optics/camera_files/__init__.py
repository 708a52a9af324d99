"""Readers and writers of calibrations in the formats of other tools."""
