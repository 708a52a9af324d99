"""The default hardware with mirrors on tape."""

from __future__ import annotations

from mirrorcam.cad.plan.hardware import HARDWARE

TAPED = HARDWARE.replaced(holder=HARDWARE.holder.replaced(mirrors="tape"))
