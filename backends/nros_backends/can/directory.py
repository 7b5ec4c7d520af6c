"""What a session hears: who is on the bus with which endpoints, and the samples for its subscriptions."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

from nros_backends.can.frames import EOT, MTU_CLASSIC, SOT, TOGGLE
from nros_backends.can.herald import Said
from nros_backends.can.link import Frame
from nros_backends.can.messages import (
    ENDPOINT_SUBJECT,
    HEARTBEAT_SUBJECT,
    SIGN_SUBJECT,
    STATUS_SUBJECT,
    Endpoint,
    Heartbeat,
    Sign,
    SignKind,
    Status,
)
from nros_backends.can.peers import Peer, Port, Remote
from nros_backends.can.subscription import CanSubscription
from nros_backends.can.transfers import Assembly
from nros_conformance.rmw.clock import NEVER
from nros_conformance.rmw.qos import Liveliness

_WHOLE = SOT | EOT | TOGGLE
_LENGTH_SIZE = 2
_MANAGEMENT = (ENDPOINT_SUBJECT, STATUS_SUBJECT, SIGN_SUBJECT)
_MANAGEMENT_LIMIT = 128


class Directory:
    """The receiving half of a session; under its lock, on the driving thread.

    ``subjects``: those fixed by hand, by digest of the topic. On them samples are also taken from nodes
    that announce nothing, as any Cyphal node does; elsewhere nobody could say what they are.
    """

    def __init__(self, node: int, mtu: int, subjects: Mapping[bytes, int], newcomer: Callable[[], None]) -> None:
        self.peers: dict[int, Peer] = {}
        self.fresh = False
        """Whether a sample has come; whoever looks clears it."""
        self.readers: tuple[CanSubscription, ...] = ()
        self._node = node
        self._padded = mtu > MTU_CLASSIC
        self._fixed = {subject: topic for topic, subject in subjects.items()}
        self._newcomer = newcomer
        self._strangers: dict[tuple[int, int], Port] = {}
        self._due_ns = NEVER
        """No lease expires before."""

    # Frames and transfers.

    def frame(self, frame: Frame) -> None:
        """Take in a frame of another node."""
        _, subject, node = frame.id
        data, at_ns = frame.data, frame.at_ns
        if subject == HEARTBEAT_SUBJECT:
            if data and data[-1] & _WHOLE == _WHOLE:
                self._heartbeat(node, data[:-1], at_ns)
            return
        peer = self.peers.get(node)
        if subject in _MANAGEMENT:
            if peer is None:
                return
            assembly = peer.management.get(subject)
            if assembly is None:
                assembly = peer.management[subject] = Assembly(_MANAGEMENT_LIMIT)
            transfer = assembly.frame(data)
            if transfer is not None:
                self._manage(peer, subject, transfer.payload, at_ns)
            return
        port = self._port(node, peer, subject)
        if port is None or not self._readers(node, port):
            return
        transfer = port.assembly.frame(data)
        if transfer is not None:
            payload = _unpadded(transfer.payload) if self._padded else transfer.payload
            if payload is not None:
                self._sample(peer, port, transfer.transfer_id, payload, at_ns)

    def own(self, said: Said) -> None:
        """Take in a transfer of this session itself."""
        if said.subject == HEARTBEAT_SUBJECT:
            self._heartbeat(self._node, said.payload, said.at_ns)
            return
        peer = self.peers.get(self._node)
        if peer is None:
            return
        if said.subject in _MANAGEMENT:
            self._manage(peer, said.subject, said.payload, said.at_ns)
            return
        port = peer.ports.get(said.subject)
        if port is not None and self._readers(self._node, port):
            self._sample(peer, port, said.transfer_id, said.payload, said.at_ns)

    def _port(self, node: int, peer: Peer | None, subject: int) -> Port | None:
        """The port that these frames belong to; None for samples of nobody knows what."""
        if peer is not None and subject in peer.ports:
            return peer.ports[subject]
        if subject not in self._fixed:
            return None
        return self._strangers.setdefault((node, subject), Port(subject, None))

    def _readers(self, node: int, port: Port) -> list[CanSubscription]:
        """Which subscriptions get what comes from there."""
        if port.readers is None:
            peer = self.peers.get(node)
            if peer is None or peer.ports.get(port.subject) is not port:
                topic = self._fixed[port.subject]
                port.readers = [reader for reader in self.readers if reader.topic_digest == topic]
            else:
                infos = [remote.info for remote in peer.remotes.values() if remote.info.subject == port.subject]
                port.readers = [reader for reader in self.readers if any(map(reader.meets, infos))]
                port.lifespan_ms = max((info.lifespan_ms for info in infos if not info.is_reader), default=0)
        return port.readers

    def _sample(self, peer: Peer | None, port: Port, transfer_id: int, payload: bytes, at_ns: int) -> None:
        missing = port.numbering.transfer(transfer_id, at_ns)
        if missing is None:
            return
        self._lost(port, missing, at_ns)
        for reader in port.readers or ():
            if at_ns < reader.created_ns:
                continue  # it waited on the bus from before this subscription
            port.synchronised.add(reader.number)
            reader.deliver(payload, at_ns, port.lifespan_ms)
            self.fresh = True

    def _lost(self, port: Port, missing: int, at_ns: int) -> None:
        if missing:
            for reader in self.readers:
                if reader.number in port.synchronised:
                    reader.losses.add(missing, at_ns)

    # What nodes say of themselves.

    def _heartbeat(self, node: int, payload: bytes, at_ns: int) -> None:
        heartbeat = Heartbeat.decode(payload)
        if heartbeat is None:
            return
        peer = self.peers.get(node)
        if peer is not None and peer.restarted(heartbeat):
            self._forget(peer, at_ns)
            peer = None
        if peer is None:
            peer = self.peers[node] = Peer(node, heartbeat, at_ns)
            if node != self._node:
                self._newcomer()
        peer.uptime_s, peer.heard_ns = heartbeat.uptime_s, at_ns
        back = False
        for remote in peer.remotes.values():
            back |= not remote.alive
            self._refresh(peer, remote, at_ns)
        if back and node != self._node:
            self._newcomer()  # it may have missed as much of this node

    def _manage(self, peer: Peer, subject: int, payload: bytes, at_ns: int) -> None:
        if subject == ENDPOINT_SUBJECT:
            info = Endpoint.decode(payload)
            if info is not None:
                self._endpoint(peer, info, at_ns)
        elif subject == STATUS_SUBJECT:
            status = Status.decode(payload)
            port = None if status is None else peer.ports.get(status.subject)
            if status is not None and port is not None:
                self._count(port, status.count, status.rebased, at_ns)
        else:
            sign = Sign.decode(payload)
            if sign is not None:
                self._sign(peer, sign, at_ns)

    def _endpoint(self, peer: Peer, info: Endpoint, at_ns: int) -> None:
        remote = peer.remotes.get(info.number)
        if remote is not None and remote.info.topic == info.topic and remote.info.is_reader == info.is_reader:
            remote.heard(info, at_ns)
            self._refresh(peer, remote, at_ns)
        else:
            if remote is not None:
                self._left(peer, remote, at_ns)
            remote = peer.remotes[info.number] = Remote(peer.node, peer.incarnation, info, at_ns)
            due_ns = remote.due_ns(peer.heard_ns)
            remote.alive = due_ns > at_ns
            self._due_ns = min(self._due_ns, due_ns)
            self.changed()
            for reader in self._met(remote):
                reader.came(remote, at_ns)
        if not info.is_reader:
            self._count(peer.port(info.subject, info.count), info.count, False, at_ns)

    def _count(self, port: Port, count: int, rebased: bool, at_ns: int) -> None:
        if rebased:
            port.numbering.rebase(count)
        else:
            self._lost(port, port.numbering.status(count), at_ns)

    def _sign(self, peer: Peer, sign: Sign, at_ns: int) -> None:
        if sign.kind is SignKind.ROUND:
            for remote in peer.stale(sign.round):
                self._left(peer, remote, at_ns)
        elif sign.kind is SignKind.GONE:
            if not sign.endpoint:
                self._forget(peer, at_ns)
            elif sign.endpoint in peer.remotes:
                self._left(peer, peer.remotes[sign.endpoint], at_ns)
        else:
            for remote in peer.remotes.values():
                info = remote.info
                by_node = not sign.endpoint and info.liveliness is Liveliness.MANUAL_BY_NODE
                if by_node or info.number == sign.endpoint:
                    remote.asserted_ns = at_ns
                    self._refresh(peer, remote, at_ns)

    # Who is alive.

    def expire(self, now_ns: int) -> None:
        """Find the leases that have run out."""
        if now_ns < self._due_ns:
            return
        for peer in self.peers.values():
            for remote in peer.remotes.values():
                due_ns = remote.due_ns(peer.heard_ns)
                if remote.alive and due_ns <= now_ns:
                    remote.alive = False
                    for reader in self._met(remote):
                        reader.liveliness.fell_silent(remote.key, due_ns)
        self._due_ns = min((peer.next_due_ns() for peer in self.peers.values()), default=NEVER)

    def next_due_ns(self) -> int:
        """When a lease may run out."""
        return self._due_ns

    def _refresh(self, peer: Peer, remote: Remote, at_ns: int) -> None:
        """Its lease was renewed: perhaps it is alive again."""
        if remote.alive:
            return  # it has gone when `expire` finds so, which looks after all that has come
        due_ns = remote.due_ns(peer.heard_ns)
        if due_ns > at_ns:
            remote.alive = True
            self._due_ns = min(self._due_ns, due_ns)
            for reader in self._met(remote):
                reader.liveliness.came(remote.key, at_ns)

    def _left(self, peer: Peer, remote: Remote, at_ns: int) -> None:
        del peer.remotes[remote.info.number]
        self.changed()
        for reader in self._met(remote):
            reader.liveliness.left(remote.key, at_ns)

    def _forget(self, peer: Peer, at_ns: int) -> None:
        for remote in tuple(peer.remotes.values()):
            self._left(peer, remote, at_ns)
        del self.peers[peer.node]

    def _met(self, remote: Remote) -> Iterable[CanSubscription]:
        return [reader for reader in self.readers if reader.meets(remote.info)]

    # This session's own subscriptions.

    def add(self, reader: CanSubscription, now_ns: int) -> None:
        """A subscription was created; it hears at once of whom is known."""
        self.readers = (*self.readers, reader)
        self.changed()
        for peer in self.peers.values():
            for remote in peer.remotes.values():
                if reader.meets(remote.info):
                    reader.came(remote, now_ns)

    def remove(self, reader: CanSubscription) -> None:
        """A subscription is about to be destroyed."""
        self.readers = tuple(other for other in self.readers if other is not reader)
        self.changed()

    def changed(self) -> None:
        """Endpoints came or went: who gets what has to be found anew."""
        for peer in self.peers.values():
            for port in peer.ports.values():
                port.readers = None
        for port in self._strangers.values():
            port.readers = None


def _unpadded(payload: bytes) -> bytes | None:
    """A sample on CAN FD without the padding behind it; None when its length cannot be true."""
    length = int.from_bytes(payload[:_LENGTH_SIZE], "little")
    if len(payload) < _LENGTH_SIZE + length:
        return None
    return payload[_LENGTH_SIZE : _LENGTH_SIZE + length]
