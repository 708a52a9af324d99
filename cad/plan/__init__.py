"""Dimensions and plans of parts as plain numbers, without a CAD kernel."""
