"""The default hardware with mirrors that are glued."""

from __future__ import annotations

from mirrorcam.cad.plan.hardware import HARDWARE

GLUED = HARDWARE.replaced(holder=HARDWARE.holder.replaced(mirrors="glue"))
