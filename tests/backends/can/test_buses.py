from __future__ import annotations

import errno
import os
import re
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import can
import pytest
from can.interfaces.virtual import VirtualBus

from nros_backends.can import CanBackend
from nros_backends.can.buses import Buses, LoopbackMulticastBus, subject_table
from nros_backends.can.nodes import FIRST, LAST, NodeIds
from nros_conformance.rmw.backend import Host, SessionOptions
from nros_conformance.rmw.clock import MonotonicClock
from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.declaration import load_declaration
from nros_conformance.rmw.events import EventKind
from nros_conformance.rmw.qos import History
from tests.backends.can.conftest import publisher, subscription, take
from tests.backends.log import Log

PEER = """
import sys
from pathlib import Path
from nros_backends.can import CanBackend
from nros_conformance.rmw.backend import Host, SessionOptions
from nros_conformance.rmw.clock import MonotonicClock
from nros_conformance.rmw.qos import QosProfile
port, network, scratch = int(sys.argv[1]), int(sys.argv[2]), Path(sys.argv[3])
backend = CanBackend(
    Host(MonotonicClock(), ports=range(port, port + 2), network=network, scratch=scratch, processes=True)
)
session = backend.create_session(SessionOptions())
talker = session.create_publisher("topic", "std_msgs/msg/String", QosProfile(lease_ms=500))
while not backend.matched(talker):
    session.drive_io(5)
for number in range(100):
    assert talker.publish_raw(b"%d " % number * 4) == 0
    session.drive_io(1)
print(session.node, flush=True)
while True:
    session.drive_io(10)
"""


@pytest.fixture
def port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1]) & ~1


def apart(port: int, scratch: Path) -> Host:
    return Host(MonotonicClock(), ports=range(port, port + 2), network=port % 200, scratch=scratch, processes=True)


def drive_until(session: object, holds: object, tries: int = 2_000) -> None:
    assert callable(holds)
    for _ in range(tries):
        if holds():
            return
        session.drive_io(5)  # type: ignore[attr-defined]
    pytest.fail("it did not happen")


def test_sessions_of_two_processes_meet_on_loopback(port: int, tmp_path: Path) -> None:
    backend = CanBackend(apart(port, tmp_path))
    session = backend.create_session(SessionOptions())
    listener = subscription(session, history=History.KEEP_ALL)  # type: ignore[arg-type]
    alive = Log().watch(listener, EventKind.LIVELINESS_CHANGED)
    peer = subprocess.Popen(
        [sys.executable, "-c", PEER, str(port), str(port % 200), str(tmp_path)], stdout=subprocess.PIPE, text=True
    )
    try:
        samples: list[bytes] = []

        def all_came() -> bool:
            samples.extend(take(listener))
            return len(samples) == 100

        drive_until(session, all_came)
        assert samples == [b"%d " % number * 4 for number in range(100)]
        assert listener.losses.total == 0
        assert alive.counts == (1, 0)
        assert peer.stdout is not None
        assert int(peer.stdout.readline()) != session.node  # type: ignore[attr-defined]
        peer.kill()
        drive_until(session, lambda: alive.counts == (0, 1))
    finally:
        peer.kill()
        peer.wait()
        assert peer.stdout is not None
        peer.stdout.close()
        backend.close()


def test_multicast_stays_on_loopback(port: int) -> None:
    bus = LoopbackMulticastBus("239.74.163.251", port)
    device, joined = "", []
    for line in Path("/proc/net/igmp").read_text().splitlines()[1:]:
        if not line.startswith("\t"):
            device = line.split()[1]
        elif line.split()[0] == "FBA34AEF":
            joined.append(device)
    assert joined == ["lo"]
    bus.shutdown()


def test_an_own_echo_is_no_collision_and_no_sample(port: int, tmp_path: Path) -> None:
    backend = CanBackend(apart(port, tmp_path))
    session = backend.create_session(SessionOptions())
    talker, listener = publisher(session), subscription(session)  # type: ignore[arg-type]
    for number in range(5):
        assert session.drive_io(1) == ReturnCode.OK
        assert talker.publish_raw(b"same" * number) == ReturnCode.OK
    for _ in range(5):
        assert session.drive_io(1) == ReturnCode.OK
    assert take(listener)[-1:] == [b"same" * 4]
    assert listener.losses.total == 0
    assert talker.session.link.foreign_ns is None
    backend.close()


def test_junk_on_the_port_is_ignored(port: int, tmp_path: Path) -> None:
    backend = CanBackend(apart(port, tmp_path))
    session = backend.create_session(SessionOptions())
    listener = subscription(session)  # type: ignore[arg-type]
    talker = publisher(backend.create_session(SessionOptions()))  # type: ignore[arg-type]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))
        for _ in range(5):
            sender.sendto(b"\xc1junk", backend._buses.address(0))
    for _ in range(2):
        assert session.drive_io(5) == talker.session.drive_io(5) == ReturnCode.OK
    assert talker.publish_raw(b"good") == ReturnCode.OK
    drive_until(session, lambda: listener.has_data() is True)
    assert take(listener) == [b"good"]
    backend.close()


def test_a_ready_made_bus_is_taken() -> None:
    backends = [
        CanBackend(Host(MonotonicClock(), options={"node": node}), VirtualBus("a bus of the application"))
        for node in ("10", "125")  # two backends do not know of each other's ids
    ]
    sessions = [backend.create_session(SessionOptions()) for backend in backends]
    assert [session.node for session in sessions] == [10, 125]  # type: ignore[attr-defined]
    talker, listener = publisher(sessions[0]), subscription(sessions[1])  # type: ignore[arg-type]
    for _ in range(3):
        for session in sessions:
            session.drive_io(0)
    talker.publish_raw(b"hello")
    sessions[1].drive_io(1_000)
    assert take(listener) == [b"hello"]
    for backend in backends:
        backend.close()


@pytest.mark.parametrize(
    ("options", "code", "text"),
    [
        ({"fd": "yes"}, ReturnCode.INVALID_CONFIG, """fd is 'yes': give "true" or "false\""""),
        ({"subjects": "a=9000"}, ReturnCode.INVALID_CONFIG, "subjects: 'a=9000' is not topic=subject, 0 to 6140"),
        ({"subjects": "a=7,b=7"}, ReturnCode.INVALID_CONFIG, "subjects: 'a' and 'b' share subject 7"),
        (
            {"interface": "socketcan", "channel": "vcan0"},
            ReturnCode.INVALID_CONFIG,
            "socketcan: no channel for domain 1; give one for each, such as channel=can0,can1",
        ),
        ({"node": "126"}, ReturnCode.INVALID_CONFIG, "node is '126': give a node id, 1 to 125"),
        ({"node": "x"}, ReturnCode.INVALID_CONFIG, "node is 'x': give a node id, 1 to 125"),
        ({"interface": "nonsense", "channel": "x,y"}, ReturnCode.CONNECTION_FAILED, None),
    ],
)
def test_options_that_make_no_sense_are_refused(options: dict[str, str], code: ReturnCode, text: str | None) -> None:
    with pytest.raises(RmwError) as raised:
        CanBackend(Host(MonotonicClock(), options=options)).create_session(SessionOptions(domain_id=1))
    assert raised.value.code is code
    if text is not None:
        assert raised.value.detail == text


def test_the_interface_and_what_it_takes_come_from_the_options() -> None:
    host = Host(MonotonicClock(), options={"interface": "udp_multicast", "channel": "239.0.0.9", "port": "5000"})
    assert Buses(host).address(0) == ("239.0.0.9", 5000)
    virtual = CanBackend(Host(MonotonicClock(), options={"interface": "virtual", "channel": "shared"}))
    virtual.create_session(SessionOptions(domain_id=1))
    assert "shared 1" in {config["channel"] for config in can.detect_available_configs("virtual")}
    virtual.close()
    assert subject_table({"subjects": "/a=1, b/c=2"}) == {"a": 1, "b/c": 2}


def test_plays_and_domains_have_groups_of_their_own() -> None:
    addresses = {
        Buses(Host(MonotonicClock(), network=network, ports=range(5_000, 5_004))).address(domain)
        for network in range(100)
        for domain in (0, 1)
    }
    assert len(addresses) == 200


def test_every_session_has_a_node_id_of_its_own() -> None:
    nodes = NodeIds(None)
    leased = [nodes.lease(0) for _ in range(LAST - FIRST + 1)]
    assert sorted(leased) == list(range(FIRST, LAST + 1))
    assert nodes.lease(1) in leased, "another bus"
    with pytest.raises(RmwError, match="all 125 node ids of the bus are taken") as raised:
        nodes.lease(0)
    assert raised.value.code is ReturnCode.CONNECTION_FAILED
    nodes.release(0, 40)
    assert nodes.lease(0) == 40


def test_node_ids_are_leased_among_processes(tmp_path: Path) -> None:
    scratch = tmp_path / "scratch"
    first, second = NodeIds(scratch), NodeIds(scratch)  # as in two processes: the locks are the kernel's
    leased = [ids.lease(0) for _ in range(20) for ids in (first, second)]
    assert len(set(leased)) == 40
    first.release(0, leased[0])
    other = NodeIds(scratch)
    assert leased[0] in {other.lease(0) for _ in range(LAST - FIRST + 1 - 39)}
    for node in leased[1:]:
        first.release(0, node)
        second.release(0, node)


def test_the_declaration_holds_what_the_adapter_does() -> None:
    from nros_backends.can.policies import MIN_LEASE_MS
    from nros_backends.can.session import LEASE_MS

    declaration = load_declaration(Path(sys.modules["nros_backends.can"].__file__ or "").parent / "backend.toml")
    assert declaration.bounds.min_lease.ns({}) == MIN_LEASE_MS * 1_000_000
    assert declaration.connection.lease.ns({}) == LEASE_MS * 1_000_000
    assert set(declaration.claims().values()) == {"yes"}


@pytest.mark.parametrize(
    ("number", "remedy"),
    [
        (errno.EAFNOSUPPORT, "; the kernel has no CAN sockets here; try: sudo modprobe -a can_raw vcan"),
        (errno.ENODEV, "; try: sudo ip link add dev vcan7 type vcan && sudo ip link set vcan7 up"),
        (errno.ENETDOWN, "; try: sudo ip link set vcan7 up"),
        (errno.EPERM, ""),
    ],
)
def test_without_socketcan_it_is_said_what_brings_it(monkeypatch: pytest.MonkeyPatch, number: int, remedy: str) -> None:
    def bus(**arguments: Any) -> Any:
        assert (arguments["interface"], arguments["channel"]) == ("socketcan", "vcan7")
        raise OSError(number, "it says")

    monkeypatch.setattr("can.Bus", bus)
    backend = CanBackend(Host(MonotonicClock(), options={"interface": "socketcan", "channel": "vcan7,vcan8"}))
    for call in (lambda: backend.create_session(SessionOptions()), backend.versions):
        with pytest.raises(RmwError) as raised:
            call()
        assert raised.value.code is ReturnCode.CONNECTION_FAILED
        assert raised.value.detail == f"socketcan: [Errno {number}] it says{remedy}"


def test_the_page_about_buses_is_true(capsys: pytest.CaptureFixture[str]) -> None:
    page = (Path(__file__).parents[3] / "docs" / "can.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    exec(compile(example, "can.md", "exec"), {"__name__": "example"})
    assert capsys.readouterr().out == "[b'hello']\n"
    no_sockets = OSError(errno.EAFNOSUPPORT, os.strerror(errno.EAFNOSUPPORT))
    buses = Buses(Host(MonotonicClock(), options={"interface": "socketcan"}))
    assert f"socketcan: {no_sockets}{buses._remedy(no_sockets)}\n" in page
