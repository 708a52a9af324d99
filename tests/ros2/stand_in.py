"""A stand-in of ROS 2 for tests: messages that check their fields as generated ones do, and what is used of rclpy."""

from __future__ import annotations

import sys
import threading
from array import array
from dataclasses import dataclass, field
from functools import cache
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

CODES = {"uint8": "B", "float32": "f", "float64": "d"}
RANGES = {"uint8": (0, 2**8), "uint32": (0, 2**32), "int32": (-(2**31), 2**31)}
NAMES = {"float64": "double", "float32": "float", "bool": "boolean"}
PACKAGES = ("builtin_interfaces", "geometry_msgs", "sensor_msgs", "std_msgs", "tf2_msgs")


@cache
def typestore() -> Any:
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_HUMBLE)


@cache
def message_class(message_type: str) -> Any:
    """A class like that which rosidl generates: fields by keyword, each checked."""
    from rosbags.interfaces import Nodetype

    _, fields = typestore().fielddefs[message_type]

    def checked(name: str, value: Any, kind: Any) -> Any:
        node, what = kind
        if node == Nodetype.NAME:
            assert type(value) is message_class(what), name
        elif node == Nodetype.BASE:
            check_number_or_text(name, value, what[0])
        elif node == Nodetype.ARRAY:
            (_, (base, _)), count = what
            assert isinstance(value, np.ndarray), name
            assert (value.dtype, value.size) == (np.dtype(base), count), name
        elif what[0][0] == Nodetype.NAME:
            assert isinstance(value, list), name
            assert all(type(each) is message_class(what[0][1]) for each in value), name
        else:
            assert isinstance(value, array), name
            assert value.typecode == CODES[what[0][1][0]], name
        return value

    def written(kind: Any) -> str:
        node, what = kind
        if node == Nodetype.NAME:
            return str(what).replace("/msg/", "/")
        if node == Nodetype.BASE:
            return NAMES.get(what[0], what[0])
        return f"{written(what[0])}[{what[1]}]" if node == Nodetype.ARRAY else f"sequence<{written(what[0])}>"

    class Message:
        def __init__(self, **given: Any) -> None:
            assert set(given) == {name for name, _ in fields}, message_type
            for name, kind in fields:
                setattr(self, name, checked(name, given[name], kind))

        @classmethod
        def get_fields_and_field_types(cls) -> dict[str, str]:
            return {name: written(kind) for name, kind in fields}

        def plain(self) -> Any:
            """The same message of rosbags, which serializes it."""
            values = {name: getattr(self, name) for name, _ in fields}
            return typestore().types[message_type](**{name: plain(value) for name, value in values.items()})

    return Message


def check_number_or_text(name: str, value: Any, base: str) -> None:
    if base in RANGES:
        assert isinstance(value, int), name
        assert RANGES[base][0] <= value < RANGES[base][1], name
    else:
        assert type(value) is {"string": str, "bool": bool, "float64": float}[base], name


def plain(value: Any) -> Any:
    if isinstance(value, list):
        return [plain(each) for each in value]
    if isinstance(value, array):
        return np.array(value)
    return value.plain() if hasattr(value, "plain") else value


@dataclass
class Publisher:
    kind: Any
    quality: Any
    sent: list[Any] = field(default_factory=list)
    listeners: int = 0

    def publish(self, message: Any) -> None:
        assert type(message) is self.kind
        self.sent.append(message)

    def get_subscription_count(self) -> int:
        return self.listeners


@dataclass
class Ros:
    """What a test gives to the node, and what the node did."""

    parameters: dict[str, Any] = field(default_factory=dict)
    listened: tuple[str, ...] = ()
    publishers: dict[str, Publisher] = field(default_factory=dict)
    logged: list[tuple[str, str]] = field(default_factory=list)
    over: threading.Event = field(default_factory=threading.Event)


def installed(monkeypatch: pytest.MonkeyPatch) -> Ros:
    """Put the stand-in where `import rclpy` and the packages of messages find it."""
    ros = Ros()

    class Logger:
        def __getattr__(self, level: str) -> Any:
            return lambda text, **_: ros.logged.append((level, text))

    class Node:
        def __init__(self, name: str) -> None:
            self.name = name

        def declare_parameter(self, name: str, default: Any, descriptor: Any) -> Any:
            value = ros.parameters.get(name, default)
            assert type(value) is type(default) or descriptor.dynamic_typing, name
            return SimpleNamespace(value=value)

        def create_publisher(self, kind: Any, topic: str, quality: Any) -> Publisher:
            ros.publishers[topic] = Publisher(kind, quality, listeners=int(topic in ros.listened))
            return ros.publishers[topic]

        def get_logger(self) -> Logger:
            return Logger()

        def destroy_node(self) -> None:
            ros.over.set()

    modules: dict[str, dict[str, Any]] = {
        "rclpy": {
            "init": lambda args: None,
            "spin": lambda node: ros.over.wait(30),
            "try_shutdown": ros.over.set,
        },
        "rclpy.node": {"Node": Node},
        "rclpy.executors": {"ExternalShutdownException": type("ExternalShutdownException", (Exception,), {})},
        "rclpy.qos": {
            "QoSProfile": SimpleNamespace,
            "DurabilityPolicy": SimpleNamespace(TRANSIENT_LOCAL="latched", VOLATILE="volatile"),
            "ReliabilityPolicy": SimpleNamespace(RELIABLE="reliable"),
        },
        "rcl_interfaces": {},
        "rcl_interfaces.msg": {
            "ParameterDescriptor": lambda dynamic_typing=False: SimpleNamespace(dynamic_typing=dynamic_typing)
        },
    }
    for name, content in modules.items():
        module = ModuleType(name)
        module.__dict__.update(content)
        monkeypatch.setitem(sys.modules, name, module)
    for package in PACKAGES:
        module = ModuleType(f"{package}.msg")
        prefix = f"{package}/msg/"
        for message_type in typestore().fielddefs:
            if message_type.startswith(prefix):
                setattr(module, message_type.removeprefix(prefix), message_class(message_type))
        monkeypatch.setitem(sys.modules, package, ModuleType(package))
        monkeypatch.setitem(sys.modules, f"{package}.msg", module)
    return ros
