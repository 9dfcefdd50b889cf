"""ROS bags written by the export, read by rosbags: the messages of MCAP, in both kinds of bag."""

import errno
import os
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from formats.mcap_sample import curved_fixes, decoded, write_curved
from lgprjax.cli import main
from lgprjax.formats import DriveLog, export_mcap, import_mcap
from refusals import printed_refusal, refused

highlevel = pytest.importorskip("rosbags.highlevel")

_SCANS = 60


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The curved drive and its fixes as MCAP and as both kinds of bag."""
    folder = tmp_path_factory.mktemp("bags")
    write_curved(folder / "a.drive.h5", "int16", scans=_SCANS)
    fixes, _, _ = curved_fixes(folder, scans=_SCANS)
    for name in ("a.mcap", "a.bag", "a.db3"):
        assert export_mcap(folder / "a.drive.h5", folder / name, fixes=fixes).poses == _SCANS // 3
    return folder


def _read(bag: Path) -> tuple[dict[str, list[tuple[int, Any]]], dict[str, Any]]:
    """Messages and connection of each topic, with the definitions that the bag itself holds."""
    found: dict[str, list[tuple[int, Any]]] = {}
    with highlevel.AnyReader([bag]) as reader:
        for connection, ns, raw in reader.messages():
            found.setdefault(connection.topic, []).append((ns, reader.deserialize(raw, connection.msgtype)))
        return found, {each.topic: each for each in reader.connections}


def _assert_same(one: Any, due: Any) -> None:
    """Members of a message by rosbags, but constants and the counters of ROS 1, are those of the message by MCAP."""
    if isinstance(one, list):
        for each, other in zip(one, due, strict=True):
            _assert_same(each, other)
    elif is_dataclass(one):
        for name in [each.name for each in fields(one) if each.name[0].islower() and each.name != "seq"]:
            _assert_same(getattr(one, name), getattr(due, name))
    else:
        np.testing.assert_array_equal(one, np.frombuffer(due, np.uint8) if isinstance(due, bytes) else due)


@pytest.mark.parametrize("bag", ["a.bag", "a.db3"])
def test_a_bag_has_the_messages_of_mcap(bag: str, folder: Path) -> None:
    found, connections = _read(folder / bag)
    wanted = decoded(folder / "a.mcap")
    assert {topic: len(messages) for topic, messages in found.items()} == {t: len(m) for t, m in wanted.items()}
    assert {"/tf", "/tf_static", "/gpr/radargram", "/gnss/fix", "/lgpr/fix"} <= set(found)
    for topic, messages in wanted.items():
        for (ns, one), (due_ns, due) in zip(found[topic], messages, strict=True):
            assert ns == due_ns
            _assert_same(one, due)
    # Who comes late still gets how the array is mounted.
    kept = connections["/tf_static"].ext
    if bag == "a.bag":
        assert (kept.latching, connections["/tf"].ext.latching) == (1, 0)
        # What ROS 1 itself calls these definitions: subscribers take no others.
        digests = {topic: connections[topic].digest for topic in ("/tf", "/gpr/radargram", "/gnss/fix")}
        assert digests == {
            "/tf": "94810edda583a504dfda3829e70d7eec",
            "/gpr/radargram": "060021388200f6f0f447d0fcd9c64743",
            "/gnss/fix": "2d3a8cd499b9b4a0249fb98fd05cfa48",
        }
    else:
        (qos,) = kept.offered_qos_profiles
        assert (qos.durability.name, qos.reliability.name, qos.history.name) == (
            "TRANSIENT_LOCAL",
            "RELIABLE",
            "KEEP_LAST",
        )


@pytest.mark.parametrize("bag", ["a.bag", "a.db3/a.db3"])
def test_a_bag_comes_back(bag: str, folder: Path, tmp_path: Path) -> None:
    assert import_mcap(folder / bag, output=tmp_path / "b.drive.h5").scans == _SCANS
    with DriveLog.open(tmp_path / "b.drive.h5") as found, DriveLog.open(folder / "a.drive.h5") as wanted:
        for one, other in zip(found.read_stored(0, _SCANS), wanted.read_stored(0, _SCANS), strict=True):
            np.testing.assert_array_equal(one, other)
        navigation, due = found.description.navigation, wanted.description.navigation
        np.testing.assert_array_equal(navigation.latitude_deg, due.latitude_deg)


def test_what_exists_is_kept_unless_told_otherwise(folder: Path, tmp_path: Path) -> None:
    drive = folder / "a.drive.h5"
    (tmp_path / "notes.db3").mkdir()
    (tmp_path / "notes.db3" / "read.me").write_text("mine")
    for name in ("x.bag", "x.db3"):
        export_mcap(drive, tmp_path / name)
        with refused("output", "--force", file=name):
            export_mcap(drive, tmp_path / name)
        export_mcap(drive, tmp_path / name, force=True)
    assert len(_read(tmp_path / "x.db3")[0]["/gpr/scan"]) == _SCANS
    with refused("output", "metadata.yaml", file="notes.db3"):
        export_mcap(drive, tmp_path / "notes.db3", force=True)
    (tmp_path / "x.db3" / "read.me").write_text("mine")
    with refused("output", "metadata.yaml", file="x.db3"):
        export_mcap(drive, tmp_path / "x.db3", force=True)
    (tmp_path / "x.db3" / "read.me").unlink()
    with refused("output"):
        export_mcap(drive, tmp_path / "nowhere" / "x.db3")
    with refused("file name", ".mcap", ".bag", ".db3", found="'.csv'"):
        export_mcap(drive, tmp_path / "x.csv")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["notes.db3", "x.bag", "x.db3"]
    assert [path.name for path in (tmp_path / "notes.db3").iterdir()] == ["read.me"]


def test_a_bag_that_cannot_be_replaced_stays(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    export_mcap(folder / "a.drive.h5", tmp_path / "x.db3")
    held = {path.name: path.read_bytes() for path in (tmp_path / "x.db3").iterdir()}
    move = Path.replace

    def full(path: Path, target: Path) -> Path:
        if path.name == "x" and target == tmp_path / "x.db3":
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return move(path, target)

    monkeypatch.setattr(Path, "replace", full)
    with refused("output", found=os.strerror(errno.ENOSPC)):
        export_mcap(folder / "a.drive.h5", tmp_path / "x.db3", force=True)
    assert {path.name: path.read_bytes() for path in (tmp_path / "x.db3").iterdir()} == held
    assert [path.name for path in tmp_path.iterdir()] == ["x.db3"]


def test_the_command_tells_the_bag_and_its_scans(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["export", str(folder / "a.drive.h5"), "-o", str(tmp_path / "x.db3")]
    for expected in (0, 1):
        with pytest.raises(SystemExit) as stopped:
            main(command)
        assert stopped.value.code == expected
    told = capsys.readouterr()
    (result,) = (line for line in told.out.splitlines() if str(tmp_path / "x.db3") in line and "result" in line)
    assert str(_SCANS) in result
    printed_refusal(told.err).check("output", "--force", file="x.db3")
