"""Convert messages of the library to ROS 2, whose classes are passed in; this module does not need ROS."""

from __future__ import annotations

from array import array
from collections.abc import Callable
from typing import Any

import numpy as np

from mirrorcam.optics.light_field.io.ros_messages import RosMessage

MessageClass = Callable[[str], Any]
"""Returns the class of a type such as `sensor_msgs/msg/Image`."""


def ros_message(message: RosMessage, class_of: MessageClass) -> Any:
    """The ROS 2 message with the same fields, nested messages included.

    Sequences of numbers become `array.array`, which messages store without checking every item; arrays of a fixed
    length stay NumPy arrays, as in ROS messages.
    """
    kind = class_of(message.type)
    types = kind.get_fields_and_field_types()
    return kind(**{name: _value(value, types[name], class_of) for name, value in message.fields.items()})


def _value(value: Any, field_type: str, class_of: MessageClass) -> Any:
    if isinstance(value, RosMessage):
        return ros_message(value, class_of)
    if isinstance(value, list):
        return [_value(item, "", class_of) for item in value]
    if isinstance(value, np.ndarray) and field_type.startswith("sequence<"):
        numbers = array(value.dtype.char)
        numbers.frombytes(np.ascontiguousarray(value).view(np.uint8).data)
        return numbers
    return value
