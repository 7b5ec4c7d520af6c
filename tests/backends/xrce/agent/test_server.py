from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator

import pytest

from nros_backends.xrce.agent.command import describe_datagram
from nros_backends.xrce.agent.core import EntityInfo
from nros_backends.xrce.agent.server import AgentServer
from nros_backends.xrce.wire import Header, Message, decode, encode
from nros_backends.xrce.wire import messages as m
from nros_backends.xrce.wire.ids import CLIENT, NO_SESSION, RELIABLE
from nros_conformance.cli.main import main
from tests.backends.xrce.agent.peer import PARTICIPANT, create

COMMAND = [sys.executable, "-m", "nros_conformance.cli.main", "xrce-agent"]
CREATE = encode(Message(Header(NO_SESSION), (m.CreateClient(key=7, session=0x81, mtu=508),)))
ENTITY = encode(Message(Header(0x81, RELIABLE, 0), (create(PARTICIPANT, m.Ref("default_xrce_participant")),)))
GOODBYE = encode(Message(Header(0x81), (m.Delete(request=2, object=CLIENT),)))


@pytest.fixture
def client() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.settimeout(10)
        yield one


def ask(client: socket.socket, address: tuple[str, int], datagram: bytes) -> Message:
    client.sendto(datagram, address)
    return decode(client.recv(65_535))


def test_a_client_is_served_over_udp(client: socket.socket) -> None:
    with AgentServer() as server:
        assert ask(client, server.address, CREATE).submessages == (m.StatusAgent(status=0),)
        assert server.clients() == (7,)
        status = ask(client, server.address, ENTITY).submessages[0]
        assert isinstance(status, m.StatusReply)
        assert status.status == 0
        assert server.entities() == (EntityInfo(7, PARTICIPANT, 0),)


def test_what_is_due_by_time_comes_without_being_asked_for(client: socket.socket) -> None:
    with AgentServer() as server:
        ask(client, server.address, CREATE)
        ask(client, server.address, ENTITY)
        assert isinstance(decode(client.recv(100)).submessages[0], m.Acknack)
        assert decode(client.recv(100)).submessages == (m.Heartbeat(first=0, last=0, stream=RELIABLE),)


def test_the_port_is_free_again_and_no_thread_stays() -> None:
    threads = threading.active_count()
    server = AgentServer()
    server.start()
    host, port = server.address
    with pytest.raises(OSError, match="in use"):
        AgentServer(port, host)
    server.close()
    server.close()
    assert threading.active_count() == threads
    AgentServer(port, host).close()


def test_many_agents_one_after_the_other_leave_no_descriptor() -> None:
    def descriptors() -> int:
        return len(os.listdir("/proc/self/fd"))  # noqa: PTH208

    AgentServer().close()
    before = descriptors()
    for _ in range(100):
        with AgentServer():
            pass
    assert descriptors() == before


def test_a_stop_before_the_start_is_not_forgotten() -> None:
    server = AgentServer()
    server.stop()
    server.serve()
    server.close()


def test_the_agent_tells_of_every_datagram_and_every_change_of_its_graph(client: socket.socket) -> None:
    seen: list[str] = []
    graphs: list[int] = []
    with AgentServer(
        watch=lambda direction, address, payload: seen.append(describe_datagram(direction, address, payload)),
        changed=lambda graph: graphs.append(len(graph)),
    ) as server:
        ask(client, server.address, CREATE)
        ask(client, server.address, ENTITY)
        client.recv(100)
        client.sendto(b"x", server.address)
        ask(client, server.address, GOODBYE)
    place = f"127.0.0.1:{client.getsockname()[1]}"
    assert [line for line in seen if "Heartbeat" not in line] == [
        f"<- {place} session 0x80 stream 0x00 #0: CreateClient",
        f"-> {place} session 0x81 stream 0x00 #0: StatusAgent",
        f"<- {place} session 0x81 stream 0x80 #0: Create",
        f"-> {place} session 0x81 stream 0x80 #0: StatusReply",
        f"-> {place} session 0x81 stream 0x00 #0: Acknack",
        f"<- {place} malformed XRCE message at byte 0: message header needs 2 bytes, 1 are left",
        f"<- {place} session 0x81 stream 0x00 #0: Delete",
        f"-> {place} session 0x81 stream 0x00 #0: StatusReply",
    ]
    assert graphs == [1, 0]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_the_command_says_where_it_listens_lists_its_graph_and_ends_cleanly(
    number: signal.Signals, client: socket.socket
) -> None:
    with subprocess.Popen(
        [*COMMAND, "--port", "0", "--list", "-v"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        first = process.stdout.readline()
        assert first.startswith("listening on 127.0.0.1:")
        address = ("127.0.0.1", int(first.rpartition(":")[2]))
        ask(client, address, CREATE)
        ask(client, address, ENTITY)
        lines = [process.stdout.readline() for _ in range(7)]
        process.send_signal(number)
        rest, errors = process.communicate(timeout=20)
    assert (process.returncode, errors) == (0, "")
    assert lines[0] == f"<- 127.0.0.1:{client.getsockname()[1]} session 0x80 stream 0x00 #0: CreateClient\n"
    assert lines[-2:] == ["1 entities\n", "  client 00000007 PARTICIPANT#1 domain 0\n"]
    assert "Traceback" not in rest


def test_a_port_that_is_taken_or_none_is_a_usage_error(capsys: pytest.CaptureFixture[str]) -> None:
    with AgentServer() as server:
        port = server.address[1]
        assert main(["xrce-agent", "--port", str(port)]) == 4
    assert main(["xrce-agent", "--port", "70000"]) == 4
    assert capsys.readouterr().err == (
        f"nros-conformance xrce-agent: cannot listen on 127.0.0.1:{port}: Address already in use\n"
        "nros-conformance xrce-agent: --port is 70000, a port is 0 to 65535\n"
    )
