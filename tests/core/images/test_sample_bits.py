"""Samples of 16 bits are scaled by the bits that are used, and a set of pictures by those of all of them."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.images.sample_bits import ALL, SampleBits, to_8_bits


@pytest.mark.parametrize("bits", [8, 10, 12, 14, 16])
def test_the_lowest_bits_that_hold_the_largest_sample_are_used(bits: int) -> None:
    ramp = np.arange(1 << bits, dtype=np.uint16)
    found = SampleBits.of(ramp)
    assert found.used == bits
    assert np.array_equal(to_8_bits(ramp, found.used), ramp >> (bits - 8))
    assert to_8_bits(ramp, found.used).max() == 255


def test_a_set_is_scaled_by_its_largest_sample() -> None:
    some = [SampleBits.of(np.array([largest], np.uint16)) for largest in (200, 4095, 900)]
    assert [each.used for each in some] == [8, 12, 10]
    assert SampleBits.combined(some).used == 12
    assert SampleBits.combined([]).used == 8


@pytest.mark.parametrize("bits", [10, 12, 14])
def test_stated_bits_are_the_highest_or_the_lowest_as_the_samples_tell(bits: int) -> None:
    dark = np.arange(1 << (bits - 4), dtype=np.uint16)
    assert SampleBits.of(dark, bits).used == bits
    assert SampleBits.of(dark << (ALL - bits), bits).used == ALL
    assert SampleBits.of(dark, 16).used == ALL
    assert SampleBits.combined([SampleBits.of(dark, bits), SampleBits.of(dark, bits)]).stated == bits


def test_samples_beyond_the_used_bits_stay_white() -> None:
    assert to_8_bits(np.array([4095, 4096, 65535], np.uint16), 12).tolist() == [255, 255, 255]
