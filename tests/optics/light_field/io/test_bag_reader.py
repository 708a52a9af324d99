"""Round trips of light fields through bags, also through bags recorded again; bad ones are refused in one line."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirrorcam.core.disk import array_files
from mirrorcam.core.disk.bags import checked_chunks
from mirrorcam.core.errors import InputError
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.optics.light_field.io.formats.mcap import StoredBag
from mirrorcam.optics.light_field.light_field import LightField
from tests.core.video.videos import pictures
from tests.nightly import a_few
from tests.optics.light_field.io.bags import STEP_NS, needs_rosbags, write_bag

pytestmark = needs_rosbags
COUNT = 4


@pytest.fixture(scope="module")
def light_fields(decoder: Decoder) -> list[LightField]:
    return [decoder.decode(picture) for picture in pictures(COUNT, 320, 192)]


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory, light_fields: list[LightField]) -> Path:
    return write_bag(tmp_path_factory.mktemp("bag") / "a.mcap", light_fields)


def assert_same(found: LightField, expected: LightField) -> None:
    for field in fields(LightField):
        one, other = getattr(found, field.name), getattr(expected, field.name)
        assert np.asarray(one).dtype == np.asarray(other).dtype
        assert np.array_equal(one, other), field.name


def recorded_again(bag: Path, folder: Path, change: Callable[[int, Any, int, Any], Any]) -> Path:
    """Write a rosbag2 folder with the messages that `change(number, connection, time, raw)` returns, if any."""
    from rosbags.rosbag2 import Reader, StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    with Reader(bag) as reader, Writer(folder, version=8, storage_plugin=StoragePlugin.SQLITE3) as writer:
        made: dict[str, Any] = {}
        for number, (connection, time_ns, raw) in enumerate(reader.messages()):
            changed = change(number, connection, time_ns, raw)
            if changed is not None:
                topic, new_time, new_raw = changed
                if topic not in made:
                    made[topic] = writer.add_connection(topic, connection.msgtype, typestore=store)
                writer.write(made[topic], new_time, new_raw)
    return folder


def test_light_fields_and_stamps_survive_the_round_trip(bag: Path, light_fields: list[LightField]) -> None:
    stored = StoredBag(bag)
    assert stored.stamps_ns == tuple(10**9 + number * STEP_NS for number in range(COUNT))
    assert stored.incomplete == 0
    for found, expected in zip(stored[:], light_fields, strict=True):
        assert_same(found, expected)
    assert_same(stored[-1], light_fields[-1])
    with pytest.raises(IndexError):
        stored[COUNT]


def test_a_bag_recorded_over_a_network_is_sorted_by_its_stamps(
    bag: Path, light_fields: list[LightField], tmp_path: Path
) -> None:
    random = np.random.default_rng(2)

    def late(number: int, connection: Any, time_ns: int, raw: Any) -> Any:
        """Up to one and a half frames late, in another namespace; the first frame lacks a view."""
        if connection.topic.endswith("view_2_1/image_rect") and time_ns == 10**9:
            return None
        topic = connection.topic.replace("/mirrorcam/", "/robot/left/")
        return topic, 10**18 + time_ns + int(random.integers(0, STEP_NS * 3 // 2)), raw

    stored = StoredBag(recorded_again(bag, tmp_path / "again", late))
    assert stored.incomplete == 1
    assert stored.stamps_ns == tuple(10**9 + number * STEP_NS for number in range(1, COUNT))
    for found, expected in zip(stored, light_fields[1:], strict=True):
        assert_same(found, expected)


@pytest.mark.parametrize(
    ("without", "message"),
    [
        (
            "views",
            r"contains no light field: topics are /mirrorcam/view_0_0/camera_info, .* more, expected \.\.\./views",
        ),
        ("weights", r"has no message on /mirrorcam/weights, expected the weights of the views"),
        ("view_0_1/image_rect", r"has no image on /mirrorcam/view_0_1/image_rect, expected an image of each view"),
    ],
)
def test_a_bag_that_lacks_a_topic_is_refused(bag: Path, tmp_path: Path, without: str, message: str) -> None:
    def lacking(number: int, connection: Any, time_ns: int, raw: Any) -> Any:
        return None if connection.topic == f"/mirrorcam/{without}" else (connection.topic, time_ns, raw)

    with pytest.raises(InputError, match=message):
        StoredBag(recorded_again(bag, tmp_path / "again", lacking))


def test_a_bag_of_two_cameras_is_refused_with_their_names(bag: Path, tmp_path: Path) -> None:
    def twice(number: int, connection: Any, time_ns: int, raw: Any) -> Any:
        return connection.topic.replace("/mirrorcam/", "/left/"), time_ns, raw

    other = recorded_again(bag, tmp_path / "left", twice)
    from rosbags.rosbag2 import Reader, StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    with Writer(tmp_path / "both", version=8, storage_plugin=StoragePlugin.MCAP) as writer:
        for path in (bag, other):
            with Reader(path) as reader:
                for connection in [each for each in reader.connections if each.topic != "/tf_static"]:
                    new = writer.add_connection(connection.topic, connection.msgtype, typestore=store)
                    for _, time_ns, raw in reader.messages([connection]):
                        writer.write(new, time_ns, raw)
    with pytest.raises(InputError, match=r"light fields of 2 cameras \(/left/, /mirrorcam/\), expected"):
        StoredBag(tmp_path / "both")


def test_an_image_of_another_size_or_encoding_is_refused(bag: Path, tmp_path: Path) -> None:
    from rosbags.typesys import Stores, get_typestore

    store: Any = get_typestore(Stores.ROS2_HUMBLE)

    def bgr(number: int, connection: Any, time_ns: int, raw: Any) -> Any:
        if connection.topic.endswith("image_rect"):
            message = store.deserialize_cdr(raw, connection.msgtype)
            message.encoding = "bgr8"
            raw = store.serialize_cdr(message, connection.msgtype)
        return connection.topic, time_ns, raw

    stored = StoredBag(recorded_again(bag, tmp_path / "again", bgr))
    with pytest.raises(InputError, match=r"an image is \d+x\d+ 'bgr8', expected \d+x\d+ 'rgb8'$"):
        stored[0]


def foreign(path: Path, bag: Path, compression: str) -> Path:
    """Return the bag rewritten by the mcap library; its zstd frames state no content size, as in ROS 2."""
    writer_module = pytest.importorskip("mcap.writer", reason="needs mcap")
    zstandard = pytest.importorskip("zstandard", reason="needs zstandard")
    from mcap.reader import make_reader

    def unsized(data: bytes, *_: Any) -> bytes:
        compressor = zstandard.ZstdCompressor().compressobj()
        return bytes(compressor.compress(data) + compressor.flush())

    kinds = writer_module.CompressionType
    with bag.open("rb") as source, path.open("wb") as target, pytest.MonkeyPatch.context() as patch:
        patch.setattr(zstandard, "compress", unsized)
        writer = writer_module.Writer(target, compression=kinds[compression], chunk_size=50_000)
        writer.start(profile="ros2", library="test")
        channels: dict[int, int] = {}
        for schema, channel, message in make_reader(source).iter_messages():
            assert schema is not None
            if channel.id not in channels:
                known = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, known, channel.metadata
                )
            writer.add_message(channels[channel.id], message.log_time, message.data, message.publish_time)
        writer.finish()
    return path


@pytest.mark.parametrize("compression", a_few(1, ["", "ZSTD"]))
def test_damaged_bags_are_refused_in_one_line_or_read_as_they_were(
    bag: Path, light_fields: list[LightField], tmp_path: Path, compression: str
) -> None:
    raw = (foreign(tmp_path / "a.mcap", bag, compression) if compression else bag).read_bytes()
    random = np.random.default_rng(8)
    path = tmp_path / "bad.mcap"
    cuts = [raw[: int(part * len(raw))] for part in (0.0, 0.001, 0.1, 0.5, 0.999)]
    for number in range(40):
        bad = bytearray(raw)
        at = int(random.integers(0, len(raw) - 9000 * (number % 2)))
        bad[at : at + 8] = random.bytes(8)
        cuts.append(bytes(bad[: len(raw)]))
    refused = 0
    for bad_bytes in cuts:
        path.write_bytes(bad_bytes)
        try:
            for light_field in StoredBag(path):
                assert light_field.samples.shape == light_fields[0].samples.shape
        except InputError as error:
            refused += 1
            assert "bad.mcap" in str(error)
            assert "\n" not in str(error)
            assert len(str(error)) <= 300
    assert refused >= 5


@pytest.mark.parametrize("compression", ["ZSTD", "LZ4", "NONE"])
def test_bags_compressed_by_other_programs_are_read(
    bag: Path, light_fields: list[LightField], tmp_path: Path, compression: str
) -> None:
    path = foreign(tmp_path / "a.mcap", bag, compression)
    assert {chunk.compression for chunk in checked_chunks(path)} == {{"NONE": ""}.get(compression, compression.lower())}
    for found, expected in zip(StoredBag(path), light_fields, strict=True):
        assert_same(found, expected)
    raw, random = path.read_bytes(), np.random.default_rng(3)
    for _ in range(10):
        at = int(random.integers(100, len(raw) // 2))
        path.write_bytes(raw[:at] + random.bytes(4) + raw[at + 4 :])
        try:
            for found, expected in zip(StoredBag(path), light_fields, strict=True):
                assert_same(found, expected)
        except InputError as error:
            assert "\n" not in str(error)


def test_an_index_that_leads_elsewhere_is_refused(bag: Path, tmp_path: Path) -> None:
    """To data that were not checked before they are decompressed."""
    raw = bytearray(bag.read_bytes())
    index = raw.index(b"\x08", raw.rindex(b"/mirrorcam/"))  # the first record of a chunk's index, after the channels
    while raw[index] != 8 or int.from_bytes(raw[index + 1 : index + 9], "little") > 2000:
        index = raw.index(b"\x08", index + 1)
    start = int.from_bytes(raw[index + 25 : index + 33], "little")
    assert raw[start] == 6
    raw[index + 25 : index + 33] = (start + 1).to_bytes(8, "little")
    (tmp_path / "bad.mcap").write_bytes(bytes(raw))
    with pytest.raises(InputError, match=r"bad\.mcap: .*its index refers to a chunk at byte \d+"):
        StoredBag(tmp_path / "bad.mcap")


def test_light_fields_larger_than_memory_are_refused(bag: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(array_files, "MAX_GROWTH", 0)
    monkeypatch.setattr(array_files, "LARGEST_BYTES", 100_000)
    with pytest.raises(InputError, match="states arrays of 0 MB"):
        StoredBag(bag)


def test_a_pointer_of_git_lfs_in_a_bag_is_named(tmp_path: Path) -> None:
    from rosbags.rosbag2 import StoragePlugin, Writer

    with Writer(tmp_path / "a", version=8, storage_plugin=StoragePlugin.SQLITE3):
        pass
    (stored,) = (tmp_path / "a").glob("*.db3")
    stored.write_text(f"version https://git-lfs.github.com/spec/v1\noid sha256:{'0' * 64}\nsize 1000000\n")
    with pytest.raises(InputError, match=r"a\.db3: is a Git LFS pointer"):
        StoredBag(tmp_path / "a")


def test_bags_whose_files_or_messages_are_compressed_are_refused(bag: Path, tmp_path: Path) -> None:
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    for mode in (CompressionMode.FILE, CompressionMode.MESSAGE):
        writer = Writer(tmp_path / mode.name, version=8, storage_plugin=StoragePlugin.MCAP)
        writer.set_compression(mode, CompressionFormat.ZSTD)
        with Reader(bag) as reader, writer:
            made = {
                each.id: writer.add_connection(each.topic, each.msgtype, typestore=store) for each in reader.connections
            }
            for connection, time_ns, raw in reader.messages():
                writer.write(made[connection.id], time_ns, raw)
        with pytest.raises(InputError, match="its files or messages are compressed, but only chunks"):
            StoredBag(tmp_path / mode.name)


def test_missing_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nowhere\.mcap: no such file"):
        StoredBag(tmp_path / "nowhere.mcap")


def test_long_texts_about_topics_are_refused_before_they_are_parsed(tmp_path: Path) -> None:
    folder = tmp_path / "bag"
    folder.mkdir()
    (folder / "metadata.yaml").write_text("a: 1\n" * 100_000)
    with pytest.raises(InputError, match=r"metadata.yaml: is larger than 0.4 MB"):
        StoredBag(folder)
    long = b"\x04" + struct.pack("<Q", 500_000) + bytes(500_000)
    end = b"\x02" + struct.pack("<Q", 20) + bytes(20) + b"\x89MCAP0\r\n"
    (tmp_path / "a.mcap").write_bytes(b"\x89MCAP0\r\n" + long + end)
    with pytest.raises(InputError, match="descriptions of topics are too long"):
        checked_chunks(tmp_path / "a.mcap")
