"""The option of all commands that write results."""

from __future__ import annotations

from pydantic import Field

FORCE = Field(
    default=False, description="also replace files that this command did not write, or that were changed since it did"
)
