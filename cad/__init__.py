"""Printable parts and cut outlines of a layout."""
