"""Connections of parts: they stand still unless it is said how far they slide."""

from __future__ import annotations

import numpy as np

from mirrorcam.cad.plan.connection import Connection


def test_a_connection_does_not_slide_by_itself() -> None:
    assert Connection("a", "mount", "clip", np.eye(4), np.eye(4)).slides_mm == 0.0
