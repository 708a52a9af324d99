"""Checks of the exported files, each read back and measured against the layout; failures are metrics, not errors."""

from __future__ import annotations

from mirrorcam.cad.checks.device_checks import check_device
from mirrorcam.cad.checks.part_checks import check_part

__all__ = ["check_device", "check_part"]
