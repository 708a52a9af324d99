"""Command lines with odd values are drawn for every command, and faults of an outcome are seen."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.robustness import options
from mirrorcam import cli


def test_every_command_is_drawn_with_its_own_options() -> None:
    drawn = [options.command_line(np.random.default_rng(seed)) for seed in range(300)]
    assert {arguments[0] for arguments, _ in drawn} == set(cli.NAMES)
    assert 0.2 < np.mean([hopeless for _, hopeless in drawn]) < 0.9
    assert options.command_line(np.random.default_rng(3)) == drawn[3]


@pytest.mark.parametrize(
    ("said", "wrong"),
    [
        ("mirrorcam: --rows 0: too few\n", ""),
        ("mirrorcam: --raws 0: too few\n", "names --raws, which is no option"),
        ("mirrorcam: one\ntwo\n", "message of 2 lines"),
        ("Traceback (most recent call last)\n", "no line of ours"),
        (f"mirrorcam: {'x' * 300}\n", "message of 311 characters"),
    ],
)
def test_faults_of_a_message_are_seen(said: str, wrong: str) -> None:
    assert options._bad_message(said, ["design"]).startswith(wrong)
    assert bool(options._bad_message(said, ["design"])) == bool(wrong)
