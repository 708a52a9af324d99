"""Tables of backs: one for each kind, chosen by its name in a file."""

from __future__ import annotations

import pytest

from mirrorcam.cad.plan.back_table import BACKS, Gen2Back, RingGauge, back_of
from mirrorcam.cad.plan.hardware import HARDWARE, Hardware
from mirrorcam.core.errors import InputError


def test_every_kind_is_read_from_a_file_by_its_name() -> None:
    for kind, table in BACKS.items():
        assert back_of(kind) == table()
        assert Hardware.model_validate({"back": {"kind": kind}}).back == back_of(kind)
        assert table.title
    assert HARDWARE.back.kind == "none"


def test_an_unknown_kind_is_refused() -> None:
    with pytest.raises(InputError, match=r"adapter shelf: expected one of none, .*gen2"):
        back_of("shelf")


def test_only_a_clamp_has_a_ring_gauge() -> None:
    assert Gen2Back().ring_gauge == RingGauge(31.5, 4.0, 8.0)
    assert back_of("none").ring_gauge is None
