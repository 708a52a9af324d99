"""Frozen values that validate themselves: the base of all values that MirrorCam writes to or reads from a file."""

from __future__ import annotations

import inspect
import math
from collections.abc import Iterator
from dataclasses import dataclass
from types import EllipsisType
from typing import TYPE_CHECKING, Annotated, Any, Generic, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    SerializerFunctionWrapHandler,
    ValidationError,
    field_validator,
    model_serializer,
)
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails, core_schema
from pydantic_core.core_schema import ValidationInfo

from mirrorcam.core.bounds import DEPTH_MM, DEPTH_OR_INF_MM
from mirrorcam.core.command_text import reading_command_text
from mirrorcam.core.errors import InputError
from mirrorcam.core.messages import one_line

FloatArray = NDArray[np.float64]
Stored = TypeVar("Stored", covariant=True)
Given = TypeVar("Given", contravariant=True)

if TYPE_CHECKING:

    class Converted(Generic[Stored, Given]):
        """Type of a field that is stored as one type, and accepts another, from which its validator converts."""

        def __get__(self, instance: object, owner: Any) -> Stored: ...
        def __set__(self, instance: object, value: Given) -> None: ...

else:

    class Converted:
        """For the interpreter, the type that is stored."""

        def __class_getitem__(cls, stored_given):
            return stored_given[0]


class InvalidValue(InputError):
    """Invalid fields of a value; its cause holds pydantic's findings, and is lost in copies and pickles."""

    @property
    def first(self) -> ErrorDetails | None:
        """The first of pydantic's findings, if they are kept."""
        cause = self.__cause__
        return cause.errors(include_url=False)[0] if isinstance(cause, ValidationError) else None

    @property
    def has_unknown_key(self) -> bool:
        """Whether a key is unknown, if the findings are kept."""
        cause = self.__cause__
        return isinstance(cause, ValidationError) and any(item["type"] == "extra_forbidden" for item in cause.errors())

    @property
    def title(self) -> str:
        """Class name of the value; empty if the findings are not kept."""
        return self.__cause__.title if isinstance(self.__cause__, ValidationError) else ""

    @property
    def reason(self) -> str:
        """The first finding without its location; the complete message if the findings are not kept."""
        return str(self) if self.first is None else self.first["msg"].removeprefix("Value error, ")


NOT_ALL_FINITE = "holds a value that is NaN or infinite, expected finite numbers"


@dataclass(frozen=True)
class Shaped:
    """Annotation that turns nested lists into a finite, read-only float64 array of a given shape.

    `None` in `shape` stands for any length; no number is larger than `largest`, nor smaller than its negative.
    """

    shape: tuple[int | None, ...]
    largest: float = np.inf

    def check(self, value: Any) -> FloatArray:
        expected = "(" + ", ".join("n" if length is None else str(length) for length in self.shape) + ")"
        try:
            array = np.array(value, dtype=np.float64) if _is_numbers(value) else None
        except (TypeError, ValueError, OverflowError):
            array = None
        if array is None:
            raise ValueError(f"not an array of numbers, expected shape {expected}")
        if array.ndim != len(self.shape) or any(
            wanted is not None and wanted != length for wanted, length in zip(self.shape, array.shape, strict=True)
        ):
            raise ValueError(f"shape {array.shape}, expected {expected}")
        if not np.isfinite(array).all():
            raise ValueError(NOT_ALL_FINITE)
        if np.abs(array).max(initial=0.0) > self.largest:
            worst = array.flat[np.abs(array).argmax()]
            raise ValueError(f"holds {worst:g}, expected numbers from {-self.largest:.15g} to {self.largest:.15g}")
        array.flags.writeable = False
        return array

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        return core_schema.no_info_plain_validator_function(
            self.check,
            serialization=core_schema.plain_serializer_function_ser_schema(lambda array: array.tolist()),
        )

    def __get_pydantic_json_schema__(
        self, schema: core_schema.CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        items: dict[str, Any] = {"type": "number"}
        if np.isfinite(self.largest):
            items |= {"minimum": -self.largest, "maximum": self.largest}
        for length in reversed(self.shape):
            lengths = {} if length is None else {"minItems": length, "maxItems": length}
            items = {"type": "array", "items": items, **lengths}
        return items


def _is_numbers(value: Any) -> bool:
    """Return whether nested lists hold only numbers; strings and booleans are not numbers."""
    if isinstance(value, list | tuple):
        return all(map(_is_numbers, value))
    kind = value.dtype.kind if isinstance(value, np.ndarray | np.generic) else ""
    return kind in ("i", "u", "f") if kind else isinstance(value, int | float) and not isinstance(value, bool)


def array_of(name: str, value: ArrayLike, *shape: int | EllipsisType | None, finite: bool = False) -> FloatArray:
    """Convert an argument to an array of real numbers, which may hold NaN and infinities unless it must be `finite`.

    `shape` has None for any length, and may begin with `...` for any leading axes. Raises InputError for arrays of
    another shape or type, TypeError for anything that is no array.
    """
    any_leading = shape[:1] == (...,)
    lengths = shape[1:] if any_leading else shape
    words = ["..." if length is ... else "n" if length is None else str(length) for length in shape]
    expected = f"({', '.join(words)}{',' if len(words) == 1 else ''})" if words else "one number"
    try:
        array = np.asarray(value)
    except ValueError:
        raise InputError(f"{name}: rows of different lengths, expected {expected}") from None
    if array.dtype.kind not in "iuf":
        if not isinstance(value, np.ndarray | list | tuple):
            raise TypeError(f"{name}: {type(value).__name__}, expected an array {expected}")
        raise InputError(f"{name}: {array.dtype}, expected real numbers {expected}")
    has_axes = array.ndim >= len(lengths) if any_leading else array.ndim == len(lengths)
    pairs = zip(reversed(lengths), reversed(array.shape), strict=False)
    if not has_axes or any(length not in (None, found) for length, found in pairs):
        raise InputError(f"{name}: shape {array.shape}, expected {expected}")
    if finite and not np.isfinite(array).all():
        raise InputError(f"{name}: {NOT_ALL_FINITE}")
    return array.astype(np.float64, copy=False)


def with_tuples(value: Any) -> Any:
    """Convert lists in nested tables to tuples, which strict validation requires in Python values."""
    if isinstance(value, dict):
        return {name: with_tuples(item) for name, item in value.items()}
    return tuple(map(with_tuples, value)) if isinstance(value, list) else value


def _depth_or_inf(depth_mm: float) -> float:
    if depth_mm <= DEPTH_MM.max or depth_mm == math.inf:
        return depth_mm
    raise ValueError(f"expected {DEPTH_OR_INF_MM}")


DepthOrInf = Annotated[float, Field(ge=DEPTH_MM.min, allow_inf_nan=True), AfterValidator(_depth_or_inf)]
"""A depth in mm, or infinity."""

Vector3 = Annotated[FloatArray, Shaped((3,))]
Points3 = Annotated[FloatArray, Shaped((None, 3))]
Matrix3 = Annotated[FloatArray, Shaped((3, 3))]
Matrix4 = Annotated[FloatArray, Shaped((4, 4))]
SquareMatrix = Annotated[FloatArray, Shaped((None, None))]


def _hashable(data: Any) -> Any:
    """A hashable form of nested dumps: equal dumps have equal hashes (0.0 and -0.0, keys in any order)."""
    if isinstance(data, dict):
        return frozenset((key, _hashable(value)) for key, value in data.items())
    return tuple(_hashable(value) for value in data) if isinstance(data, list | tuple) else data


_NUMBERS = ("int", "float")
_NO_NUMBERS = (str, bytes, bool, np.bool)
_CONTAINERS = ("list", "tuple", "set", "frozenset", "dict")
"""Types of pydantic schemas whose validation can stop at the first invalid item."""


def _number(value: Any) -> Any:
    """Refuse text and truth values, which pydantic would convert to numbers, except text of a command line."""
    if value.__class__ is float:  # nearly all are
        return value
    if isinstance(value, _NO_NUMBERS) and not (isinstance(value, str) and reading_command_text()):
        raise ValueError(f"{type(value).__name__}, expected a number")
    return value


def _adapt(schema: Any) -> None:
    """Adapt a pydantic schema: numbers are numbers, and lists and tables are read up to the first invalid item.

    Findings about all items of a long list would take gigabytes.
    """
    pending = [schema]
    while pending:
        part = pending.pop()
        if isinstance(part, dict):
            if part.get("type") == "function-before" and part["function"]["function"] is _number:
                continue  # adapted with a nested value
            if part.get("type") in _CONTAINERS:
                part["fail_fast"] = True
            if part.get("type") in _NUMBERS:
                number = dict(part)
                part.clear()
                part |= core_schema.no_info_before_validator_function(_number, number)
                continue
            pending += (inner for name, inner in part.items() if name not in ("default", "metadata"))
        elif isinstance(part, list | tuple):
            pending += part


def _described(field: FieldInfo) -> str:
    """The description of a field, with its default if that is a number or a text."""
    default = (
        f"default {field.default!r}" if isinstance(field.default, int | float | str) and field.default != "" else ""
    )
    return ", ".join(filter(None, (field.description, default)))


class Value(BaseModel):
    """A frozen value without unknown keys, NaN or infinities; equal if all fields are equal.

    However it is constructed, invalid fields raise a one-line InvalidValue.
    """

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, arbitrary_types_allowed=True, populate_by_name=True
    )

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        schema = handler(source)
        _adapt(schema)
        return schema

    @classmethod
    def __pydantic_init_subclass__(cls, **options: Any) -> None:
        """List the fields in the docstring, so that `help` shows their descriptions and defaults."""
        if cls.model_fields and "Attributes\n" not in (cls.__doc__ or ""):
            lines = (f"{name}\n    {_described(field)}".rstrip() for name, field in cls.model_fields.items())
            cls.__doc__ = "\n".join((inspect.cleandoc(cls.__doc__ or ""), "", "Attributes", "-" * 10, *lines))

    def __init__(self, **fields: Any) -> None:
        """Make a value of its fields; raises InputError for an invalid or missing one."""
        try:
            super().__init__(**fields)
        except ValidationError as error:
            raise InvalidValue(one_line(error, type(self))) from error

    # Pydantic validates nested values itself, without this __init__, and reports the location of a finding in them.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    @classmethod
    def model_validate(cls, obj: Any, **options: Any) -> Self:
        """The value of a table; raises InvalidValue. `options` are pydantic's."""
        try:
            return super().model_validate(obj, **options)
        except ValidationError as error:
            raise InvalidValue(one_line(error, cls)) from error

    @classmethod
    def model_validate_json(cls, json_data: str | bytes | bytearray, **options: Any) -> Self:
        """The value of a JSON text; raises InvalidValue. `options` are pydantic's."""
        try:
            return super().model_validate_json(json_data, **options)
        except ValidationError as error:
            raise InvalidValue(one_line(error, cls)) from error

    if not TYPE_CHECKING:  # type checkers know the fields

        def __setattr__(self, name, value):
            copy = f"value.replaced({name}=...)"
            raise AttributeError(f"{name}: a {type(self).__name__} is frozen, expected {copy}, which makes a copy")

    def __repr_args__(self) -> Iterator[tuple[str | None, Any]]:
        """The fields of the representation: those that were given, as the others have their defaults."""
        return ((name, value) for name, value in super().__repr_args__() if name in self.model_fields_set)

    __str__ = BaseModel.__repr__

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and isinstance(other, Value) and self.model_dump() == other.model_dump()

    def __hash__(self) -> int:
        return hash(_hashable(self.model_dump()))

    def replaced(self, **changes: Any) -> Self:
        """Copy with some fields changed; the copy is validated (unlike `model_copy`)."""
        fields = {name: getattr(self, name) for name in type(self).model_fields}
        return type(self)(**(fields | changes))


NOT_FINITE = "its formula has no finite value here"
"""Default reason for an unknown figure."""


def _nan_unless_finite(value: Any, info: ValidationInfo) -> Any:
    if value is None:
        return math.nan
    if isinstance(value, bool | np.bool):  # of a check that passes or fails
        return float(value)
    if isinstance(value, float | np.floating) and not math.isfinite(value):
        if info.mode == "json":
            raise ValueError("Input should be a finite number, or null")
        return math.nan
    return value


class Metric(Value):
    """One measured figure. With a `limit`, it passes at or below it (`lower_is_better`) or at or above it.

    A figure that cannot be computed is unknown, never an error: its `value` is NaN, null in files, and `reason` says
    why. It passes no limit.
    """

    value: Annotated[float, BeforeValidator(_nan_unless_finite, json_schema_input_type=float | None)] = Field(
        allow_inf_nan=True
    )
    unit: str
    limit: float | None = None
    lower_is_better: bool = True
    reason: str = Field(default="", max_length=300, validate_default=True)

    @field_validator("reason")
    @classmethod
    def _check_reason(cls, reason: str, info: ValidationInfo) -> str:
        known = math.isfinite(info.data.get("value", 0.0))
        if known and reason:
            raise ValueError(f"a known figure has the reason {reason[:80]!r} for being unknown, expected none")
        return reason if known or reason else NOT_FINITE

    @model_serializer(mode="wrap")
    def _serialized(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        fields: dict[str, Any] = handler(self)
        if self.known:
            del fields["reason"]
        else:
            fields["value"] = None
        return fields

    @property
    def known(self) -> bool:
        """Whether the figure has a value."""
        return math.isfinite(self.value)

    @property
    def passed(self) -> bool:
        if self.limit is None:
            return True
        return self.value <= self.limit if self.lower_is_better else self.value >= self.limit
