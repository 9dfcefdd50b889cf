"""ROS bags, written by rosbags itself, become the drive log that the same messages in MCAP become."""

from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from formats.mcap_sample import write_curved
from lgprjax.cli import main
from lgprjax.formats import DriveLog, export_mcap, import_mcap
from lgprjax.formats.rosbag_recording import RosbagRecording
from refusals import refused

rosbag1 = pytest.importorskip("rosbags.rosbag1")
rosbag2 = pytest.importorskip("rosbags.rosbag2")
typesys = pytest.importorskip("rosbags.typesys")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The curved drive as MCAP, as a ROS 2 bag in SQLite, and as a ROS 1 bag; the last two by rosbags."""
    folder = tmp_path_factory.mktemp("bags")
    write_curved(folder / "x.drive.h5", "int16", scans=60)
    export_mcap(folder / "x.drive.h5", folder / "x.mcap")
    store = typesys.get_typestore(typesys.Stores.LATEST)
    with (folder / "x.mcap").open("rb") as stream:
        read = make_reader(stream).iter_messages(log_time_order=False)
        found = [(schema, channel, message) for schema, channel, message in read if schema is not None]
    # In ROS 1 a header has a counter, and transforms came later.
    store1 = typesys.get_typestore(typesys.Stores.ROS1_NOETIC)
    for schema, _, _ in found:
        store.register(typesys.get_types_from_msg(schema.data.decode(), schema.name))
        if schema.name not in store1.fielddefs:
            store1.register(typesys.get_types_from_msg(schema.data.decode().split("=" * 80)[0], schema.name))
    storage = rosbag2.StoragePlugin.SQLITE3
    with (
        rosbag2.Writer(folder / "two", version=9, storage_plugin=storage) as two,
        rosbag1.Writer(folder / "one.bag") as one,
    ):
        topics = {}
        for schema, channel, message in found:
            if channel.topic not in topics:
                topics[channel.topic] = (
                    two.add_connection(channel.topic, schema.name, typestore=store),
                    one.add_connection(channel.topic, schema.name, typestore=store1),
                )
            for_two, for_one = topics[channel.topic]
            two.write(for_two, message.log_time, message.data)
            one.write(for_one, message.log_time, bytes(store.cdr_to_ros1(message.data, schema.name)))
    import_mcap(folder / "x.mcap", output=folder / "mcap.drive.h5")
    return folder


@pytest.mark.parametrize("bag", ["one.bag", "two"])
def test_a_bag_becomes_the_drive_that_mcap_becomes(bag: str, folder: Path, tmp_path: Path) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(["import", str(folder / bag), "-o", str(tmp_path / "bag.drive.h5")])
    assert stopped.value.code == 0
    with DriveLog.open(tmp_path / "bag.drive.h5") as found, DriveLog.open(folder / "mcap.drive.h5") as wanted:
        assert found.scans == wanted.scans == 60
        for one, other in zip(found.read_stored(0, 60), wanted.read_stored(0, 60), strict=True):
            np.testing.assert_array_equal(one, other)
        # The exported drive's own t0 stands in the metadata of MCAP alone.
        shift_s = found.scan_time_s[0] - wanted.scan_time_s[0]
        np.testing.assert_allclose(found.scan_time_s - shift_s, wanted.scan_time_s, atol=1e-6)
        navigation = found.description.navigation
        np.testing.assert_array_equal(navigation.latitude_deg, wanted.description.navigation.latitude_deg)
        np.testing.assert_allclose(navigation.heading_deg, wanted.description.navigation.heading_deg, atol=1e-9)
        np.testing.assert_array_equal(found.description.array.y_m, wanted.description.array.y_m)
        assert found.description.provenance["made_by"] == "lgprjax import rosbag"


def test_a_bag_cut_short_is_told(folder: Path, tmp_path: Path) -> None:
    whole = (folder / "one.bag").read_bytes()
    (tmp_path / "cut.bag").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "text.bag").write_text("a text\n")
    (tmp_path / "alone.db3").write_bytes((folder / "two" / "two.db3").read_bytes())
    for name, place, value in (
        ("cut.bag", "file", ""),
        ("text.bag", "file", ""),
        ("alone.db3", "bag", "metadata.yaml"),
    ):
        with refused(place, value, file=name):
            import_mcap(tmp_path / name, output=tmp_path / "x.drive.h5")
    assert not (tmp_path / "x.drive.h5").exists()


def test_messages_that_do_not_decode_are_left_out(tmp_path: Path) -> None:
    """A flipped byte in the count of a message's data."""
    store = typesys.get_typestore(typesys.Stores.LATEST)
    with rosbag2.Writer(tmp_path / "bad", version=9, storage_plugin=rosbag2.StoragePlugin.SQLITE3) as writer:
        connection = writer.add_connection("/text", "std_msgs/msg/String", typestore=store)
        writer.write(connection, 1, b"\0\1\0\0\4\0\0\0abc\0")
        writer.write(connection, 2, b"\0\1\0\0\xff\xff\0\0abc\0")
    recording = RosbagRecording(tmp_path / "bad")
    assert [message.values["data"] for message in recording.messages()] == ["abc"]
    assert recording.unreadable == {"/text": 1}
