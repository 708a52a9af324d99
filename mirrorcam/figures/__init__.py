"""Figures: each module draws what one room has made."""
