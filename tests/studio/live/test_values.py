"""What is asked for by default."""

from __future__ import annotations

import pickle
from pathlib import Path

from mirrorcam.studio.live.values import DECODED, LiveRequest, Orders


def test_orders_and_requests_pass_between_processes() -> None:
    orders = Orders(focus_mm=300.0, take=Path("a.png"))
    request = LiveRequest(Path("layout.json"), "0")
    assert pickle.loads(pickle.dumps((orders, request))) == (orders, request)


def test_by_default_all_pictures_of_a_frame_are_made_and_nothing_is_written() -> None:
    orders = Orders()
    assert orders.kinds == DECODED and "depth" not in DECODED
    assert orders.record is None and orders.take is None and not orders.frames
