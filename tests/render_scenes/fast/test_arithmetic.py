"""Both arithmetics compute the same, operation by operation."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.render_scenes.fast.arithmetic import Arithmetic, DrJitArithmetic, NumpyArithmetic
from mirrorcam.render_scenes.variant import SCALAR, use_variant


@pytest.fixture(params=["numpy", "drjit"])
def xp(request: pytest.FixtureRequest) -> Arithmetic:
    if request.param == "numpy":
        return NumpyArithmetic()
    if use_variant() == SCALAR:
        pytest.skip("nothing compiles here")
    return DrJitArithmetic()


def test_operations_are_those_of_single_floats(xp: Arithmetic) -> None:
    a, b = np.array([[0.25, 4.0, 2.75], [1.0, 1.0, 9.0]], dtype=np.float32)
    x, y = xp.loaded(a), xp.loaded(b)
    np.testing.assert_array_equal(np.array(xp.minimum(x, y)), np.minimum(a, b))
    np.testing.assert_array_equal(np.array(xp.maximum(x, y)), np.maximum(a, b))
    np.testing.assert_array_equal(np.array(xp.sqrt(x)), np.sqrt(a))
    np.testing.assert_array_equal(np.array(xp.where(x > y, x, 0.0)), [0.0, 4.0, 0.0])
    np.testing.assert_array_equal(np.array(xp.truncated(x)), [0, 4, 2])
    np.testing.assert_array_equal(np.array(xp.real(xp.truncated(x))), [0.0, 4.0, 2.0])
    (half,) = xp.numbers([0.5])
    np.testing.assert_array_equal(np.array(x * half), a / 2)


def test_values_are_taken_from_tables_and_put_into_canvases(xp: Arithmetic) -> None:
    table = xp.loaded(np.array([10.0, 20.0, 30.0], dtype=np.float32))
    index = xp.loaded(np.array([2, 0], dtype=np.uint32))
    canvas = xp.canvas(4)
    xp.put(canvas, index + xp.index(1), xp.take(table, index))
    np.testing.assert_array_equal(xp.finished(canvas), [0.0, 10.0, 0.0, 30.0])
