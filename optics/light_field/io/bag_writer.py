"""ROS 2 bags of light fields: MCAP files written by rosbags, which ros2 bag, Foxglove and rerun open."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal, Self

from mirrorcam.core.disk.files import TEMPORARY
from mirrorcam.core.errors import InputError
from mirrorcam.core.extras import require
from mirrorcam.core.processes.interruption import deferred
from mirrorcam.optics.light_field.io.ros_messages import Published, RosMessage

NAMESPACE = "/mirrorcam/"
"""Prefix of topics in the camera's namespace."""
_VERSION: Literal[8] = 8
"""Version of rosbag2's metadata: from 9 on, older distributions cannot read the quality of service."""


class BagWriter:
    """Writes messages to an MCAP file, which gets its name when the block ends without an error, and is removed
    otherwise.

    Parameters
    ----------
    path
        The file, .mcap; an existing one is replaced.

    Raises
    ------
    InputError
        If rosbags is not installed, or the file cannot be written.
    """

    def __init__(self, path: Path) -> None:
        require("robot")
        self.path, self._topics = path, dict[str, Any]()

    def __enter__(self) -> Self:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore

        self._store = get_typestore(Stores.ROS2_HUMBLE)
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._folder = Path(tempfile.mkdtemp(dir=self.path.parent, prefix=TEMPORARY))
            # rosbags writes a folder that contains a file of the same name.
            self._writer = Writer(self._folder / self.path.stem, version=_VERSION, storage_plugin=StoragePlugin.MCAP)
            self._writer.open()
        except OSError as error:
            raise self._write_error(error) from None
        return self

    def write(self, messages: Iterable[Published], stamp: int) -> None:
        """Write messages at a time in ns: all of them or, at Ctrl-C, none."""
        converted = [(published, self._convert(published.message)) for published in messages]
        try:
            with deferred():
                for published, message in converted:
                    raw = self._store.serialize_cdr(message, published.message.type)
                    self._writer.write(self._connection(published), stamp, raw)
        except OSError as error:
            raise self._write_error(error) from None

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            with deferred():
                if kind is None:
                    self._writer.close()
                    (self._folder / self.path.stem / f"{self.path.stem}.mcap").replace(self.path)
                else:
                    self._writer.abort()
        except OSError as error:
            raise self._write_error(error) from None
        finally:
            shutil.rmtree(self._folder, ignore_errors=True)

    def _write_error(self, error: OSError) -> InputError:
        return InputError(f"{self.path}: cannot be written: {error.strerror or error}")

    def _convert(self, value: Any) -> Any:
        """Convert a message and its nested messages to rosbags' types."""
        if isinstance(value, RosMessage):
            return self._store.types[value.type](**{name: self._convert(field) for name, field in value.fields.items()})
        return [self._convert(item) for item in value] if isinstance(value, list) else value

    def _connection(self, published: Published) -> Any:
        """Return the connection of a topic, with its quality of service."""
        from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

        topic = published.topic if published.topic.startswith("/") else NAMESPACE + published.topic
        if topic not in self._topics:
            forever = QosTime(9223372036, 854775807)  # rmw's infinite duration
            quality = Qos(
                history=QosHistory.KEEP_LAST,
                depth=1 if published.latched else 10,
                reliability=QosReliability.RELIABLE,
                durability=QosDurability.TRANSIENT_LOCAL if published.latched else QosDurability.VOLATILE,
                deadline=forever,
                lifespan=forever,
                liveliness=QosLiveliness.AUTOMATIC,
                liveliness_lease_duration=forever,
                avoid_ros_namespace_conventions=False,
            )
            self._topics[topic] = self._writer.add_connection(
                topic, published.message.type, typestore=self._store, offered_qos_profiles=[quality]
            )
        return self._topics[topic]
