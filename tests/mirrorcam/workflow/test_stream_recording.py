"""What is reported of a recording: which frames were lost, why, and whether the file was cut off."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from mirrorcam.workflow.stream_recording import losses, spans


@pytest.mark.parametrize(
    ("numbers", "text"), [([], ""), ([3], "3"), ([3, 4, 5, 9, 11, 12], "3 to 5, 9, 11 to 12"), ([0, 1], "0 to 1")]
)
def test_runs_of_numbers_are_joined(numbers: list[int], text: str) -> None:
    assert spans(numbers) == text


def test_losses_are_grouped_by_reason() -> None:
    lost = {5: "is damaged", 7: "depends on a damaged one", 6: "depends on a damaged one"}
    recording: Any = SimpleNamespace(entries=SimpleNamespace(numbers=[0, 1, 2, 3, 4], lost=lost))
    assert losses(recording, 8) == [
        "skipped 1 of 8 frames, each is damaged: 5",
        "skipped 2 of 8 frames, each depends on a damaged one: 6 to 7",
    ]
    assert losses(recording, 10)[-1] == "ends after 8 of 10 frames; the file is cut off"
    assert losses(recording, None) == losses(recording, 8)
