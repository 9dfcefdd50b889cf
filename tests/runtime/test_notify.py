"""The service manager's socket: what is said on it, by whom, and that nothing on it can hold up a loop."""

import array
import os
import signal
import socket
import struct
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

from lgprjax.runtime.service import Notifier, watchdog_s
from runtime.supervised_run import LIMIT_S, SupervisedRun


class Said(NamedTuple):
    """A datagram, and the process that the kernel says it is of."""

    text: str
    pid: int


class Manager:
    """A service manager's end of the socket."""

    def __init__(self, address: str) -> None:
        self.address = address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_PASSCRED, 1)
        self._socket.bind("\0" + address[1:] if address.startswith("@") else address)

    def hear(self, within_s: float = LIMIT_S) -> Said:
        """The next datagram."""
        self._socket.settimeout(within_s)
        data, ancillary, *_ = self._socket.recvmsg(4096, socket.CMSG_SPACE(struct.calcsize("iii")))
        ((_, _, credentials),) = ancillary
        return Said(data.decode(), array.array("i", credentials)[0])

    def hear_until(self, text: str) -> list[Said]:
        """All up to the first whose text begins so."""
        until_s = time.monotonic() + LIMIT_S
        heard = [self.hear()]
        while not heard[-1].text.startswith(text):
            assert time.monotonic() < until_s, f"no {text} among {heard}"
            heard.append(self.hear())
        return heard

    def hear_for(self, time_s: float) -> list[Said]:
        """All that comes within a time."""
        until_s = time.monotonic() + time_s
        heard: list[Said] = []
        while (left_s := until_s - time.monotonic()) > 0:
            try:
                heard.append(self.hear(left_s))
            except TimeoutError:
                break
        return heard

    def close(self) -> None:
        """No more."""
        self._socket.close()


@pytest.fixture(params=["file", "abstract"])
def manager(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Manager]:
    address = str(tmp_path / "notify") if request.param == "file" else f"@lgprjax-test-{os.getpid()}"
    found = Manager(address)
    yield found
    found.close()


def test_words_are_those_of_the_protocol(manager: Manager, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NOTIFY_SOCKET", manager.address)
    notifier = Notifier()
    notifier.ready("ready after\n1.0 s")
    notifier.watchdog()
    notifier.watchdog_within(1.5)
    notifier.status("two\nWATCHDOG=1")
    notifier.stopping()
    notifier.close()
    notifier.watchdog()
    assert [said.text for said in manager.hear_for(0.05)] == [
        "READY=1\nSTATUS=ready after 1.0 s",
        "WATCHDOG=1",
        "WATCHDOG_USEC=1500000",
        "STATUS=two WATCHDOG=1",
        "STOPPING=1",
    ]


def test_a_manager_that_does_not_read_holds_nothing_up(manager: Manager) -> None:
    notifier = Notifier(manager.address)
    began_s = time.monotonic()
    for _ in range(5000):
        notifier.watchdog()
    assert time.monotonic() - began_s < 2.0
    assert manager.hear().text == "WATCHDOG=1"
    notifier.close()


def test_a_manager_that_is_not_there_raises_nothing() -> None:
    for address in ("", "/no/such/socket", "@nobody-listens", "x" * 300, "a\0b"):
        notifier = Notifier(address)
        notifier.watchdog()
        notifier.ready("x")
        notifier.close()


def test_the_watchdog_time_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("WATCHDOG_USEC", raising=False)
    assert watchdog_s() is None
    for value, expected in (("1500000", 1.5), ("0", None), ("soon", None)):
        monkeypatch.setenv("WATCHDOG_USEC", value)
        assert watchdog_s() == expected


def test_the_watchdog_is_fed_by_the_control_loop_alone_and_a_relaunch_is_waited_for(tmp_path: Path) -> None:
    manager = Manager(str(tmp_path / "notify"))
    environment = {"NOTIFY_SOCKET": manager.address, "WATCHDOG_USEC": "1000000"}
    # A supervisor that sees no hung loop stands for one that hangs too.
    with SupervisedRun(tmp_path, environment=environment, silent_s=60.0).start() as run:
        heard = manager.hear_until("READY=1")
        assert heard[-1].pid == run.process.pid
        assert heard[-1].text.startswith("READY=1\nSTATUS=")
        (control, _), *_ = run.starts("control")
        heard += manager.hear_for(0.3)
        fed_by = [said.pid for said in heard if said.text == "WATCHDOG=1"]
        assert set(fed_by) == {control}
        os.kill(control, signal.SIGSTOP)
        manager.hear_for(0.1)
        assert [said.text for said in manager.hear_for(0.5) if said.text == "WATCHDOG=1"] == []
        os.kill(control, signal.SIGCONT)
        assert manager.hear_until("WATCHDOG=1")
        os.kill(control, signal.SIGKILL)
        heard = manager.hear_until("WATCHDOG_USEC=20000000")
        heard = manager.hear_until("WATCHDOG_USEC=1000000")
        assert heard[-1].pid == run.process.pid
        (_, (new, _)) = run.starts("control")
        assert {said.pid for said in manager.hear_for(0.3) if said.text == "WATCHDOG=1"} == {new}
        run.end()
        assert "STOPPING=1" in [said.text for said in manager.hear_for(0.1)]
        assert not (run.run_folder / "speakers").exists()
    manager.close()
