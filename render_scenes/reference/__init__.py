"""The reference renderer: path tracing through exact geometry, by Mitsuba."""
