"""What came of a calibrator on one set."""

from __future__ import annotations

from mirrorcam.core.names import Line, Name
from mirrorcam.core.values import Metric, Value


class TriedSet(Value):
    """A set that a calibrator was tried on.

    Attributes
    ----------
    name, why
        The set, and what it is for.
    dataset_sha256
        Checksum of its manifest: sets are the same where it is.
    seconds
        How long the calibrator took.
    failure
        Why there is no score; empty where there is one.
    """

    name: Name
    why: Line
    dataset_sha256: str
    seconds: float
    failure: Line = ""


class Attempt(TriedSet):
    """A set that a calibrator was tried on, with the figures of its score; without any where there is none."""

    figures: dict[str, Metric]
