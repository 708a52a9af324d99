"""The reference renderer: light paths through exact geometry, by Mitsuba."""
