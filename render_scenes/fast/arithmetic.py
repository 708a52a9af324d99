"""Array arithmetic over millions of subpixels: Dr.Jit where a backend compiles it, NumPy otherwise."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray


class Arithmetic(Protocol):
    """Arithmetic on float32 and uint32; values of `numbers` and `index` may change without a new compilation."""

    def loaded(self, values: NDArray[Any]) -> Any:
        """An array of float32 or uint32 to compute with."""

    def numbers(self, values: list[float]) -> list[Any]:
        """Floats, each for all elements."""

    def index(self, value: int) -> Any:
        """One unsigned integer for all elements."""

    def minimum(self, a: Any, b: Any) -> Any: ...

    def maximum(self, a: Any, b: Any) -> Any: ...

    def sqrt(self, a: Any) -> Any: ...

    def where(self, condition: Any, a: Any, b: Any) -> Any: ...

    def truncated(self, a: Any) -> Any:
        """Integer parts of non-negative floats, as unsigned integers."""

    def real(self, a: Any) -> Any:
        """Floats of integers."""

    def take(self, table: Any, index: Any) -> Any:
        """Elements of a table of floats."""

    def canvas(self, size: int) -> Any:
        """A new array of zeros to put values into."""

    def put(self, canvas: Any, index: Any, values: Any) -> None:
        """Write values at distinct indices of a canvas."""

    def finished(self, canvas: Any) -> NDArray[np.float32]:
        """The values of a canvas."""


class NumpyArithmetic:
    """NumPy arithmetic, for where nothing compiles."""

    def loaded(self, values: NDArray[Any]) -> Any:
        return values

    def numbers(self, values: list[float]) -> list[Any]:
        return [np.float32(value) for value in values]

    def index(self, value: int) -> Any:
        return np.uint32(value)

    def minimum(self, a: Any, b: Any) -> Any:
        return np.minimum(a, b)

    def maximum(self, a: Any, b: Any) -> Any:
        return np.maximum(a, b)

    def sqrt(self, a: Any) -> Any:
        return np.sqrt(a)

    def where(self, condition: Any, a: Any, b: Any) -> Any:
        return np.where(condition, a, b)

    def truncated(self, a: Any) -> Any:
        return a.astype(np.uint32)

    def real(self, a: Any) -> Any:
        return np.float32(a)

    def take(self, table: Any, index: Any) -> Any:
        return table[index]

    def canvas(self, size: int) -> Any:
        return np.zeros(size, dtype=np.float32)

    def put(self, canvas: Any, index: Any, values: Any) -> None:
        canvas[index] = values

    def finished(self, canvas: Any) -> NDArray[np.float32]:
        return np.asarray(canvas)


class DrJitArithmetic:
    """Dr.Jit, in the variant of Mitsuba that has been set."""

    def __init__(self) -> None:
        import drjit
        import mitsuba

        self._dr, self._float, self._uint = drjit, mitsuba.Float, mitsuba.UInt32

    def loaded(self, values: NDArray[Any]) -> Any:
        array = (self._uint if values.dtype == np.uint32 else self._float)(values)
        self._dr.eval(array)
        return array

    def numbers(self, values: list[float]) -> list[Any]:
        return [self._dr.opaque(self._float, value) for value in values]

    def index(self, value: int) -> Any:
        return self._dr.opaque(self._uint, value)

    def minimum(self, a: Any, b: Any) -> Any:
        return self._dr.minimum(a, b)

    def maximum(self, a: Any, b: Any) -> Any:
        return self._dr.maximum(a, b)

    def sqrt(self, a: Any) -> Any:
        return self._dr.sqrt(a)

    def where(self, condition: Any, a: Any, b: Any) -> Any:
        return self._dr.select(condition, a, b)

    def truncated(self, a: Any) -> Any:
        return self._uint(a)

    def real(self, a: Any) -> Any:
        return self._float(a)

    def take(self, table: Any, index: Any) -> Any:
        return self._dr.gather(self._float, table, index)

    def canvas(self, size: int) -> Any:
        canvas = self._dr.zeros(self._float, size)
        # A separate buffer, so that kernels do not depend on where it comes from.
        self._dr.make_opaque(canvas)
        return canvas

    def put(self, canvas: Any, index: Any, values: Any) -> None:
        self._dr.scatter(canvas, values, index)

    def finished(self, canvas: Any) -> NDArray[np.float32]:
        return np.asarray(canvas.numpy())
