"""The objects of one session at the agent: which exist, who needs them, and their binary bodies."""

from __future__ import annotations

import dataclasses

from nros_backends.xrce.wire.binary import (
    EndpointQos,
    GroupBody,
    ParticipantBody,
    Qos,
    ReaderBody,
    TopicBody,
    WriterBody,
    encode_binary,
)
from nros_backends.xrce.wire.ids import Kind, ObjectId
from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.qos import Durability, History, QosProfile, Reliability

_NUMBERS = range(1, 0xFFF)
"""Numbers that an object of one kind may have; 0xfff is taken by AGENT, CLIENT and SESSION."""

_GROUP = {Kind.DATAWRITER: Kind.PUBLISHER, Kind.DATAREADER: Kind.SUBSCRIBER}

PARTICIPANT_BODY = encode_binary(ParticipantBody(None, "nros_conformance"))
GROUP_BODY = encode_binary(GroupBody())


@dataclasses.dataclass(frozen=True, slots=True)
class Plan:
    """What an endpoint is made of: ``missing`` are the objects to create, with their parents, in this order."""

    endpoint: ObjectId
    topic: ObjectId
    missing: tuple[tuple[ObjectId, ObjectId], ...]


class Objects:
    """One participant, a topic per name for as long as an endpoint uses it, a publisher, a subscriber."""

    def __init__(self) -> None:
        self.participant = ObjectId(1, Kind.PARTICIPANT)
        self._taken: dict[Kind, set[int]] = {kind: set() for kind in Kind}
        self._topics: dict[str, tuple[ObjectId, str, set[ObjectId]]] = {}
        self._groups: set[Kind] = set()

    def type_of(self, topic_name: str) -> str | None:
        """The type of a topic in use; None when it is not."""
        known = self._topics.get(topic_name)
        return None if known is None else known[1]

    def plan(self, kind: Kind, topic_name: str, type_name: str) -> Plan:
        """Take ids for an endpoint and what it needs. Raises `RmwError` BAD_ALLOC."""
        endpoint = self._take(kind)
        missing = []
        if topic_name not in self._topics:
            try:
                self._topics[topic_name] = (self._take(Kind.TOPIC), type_name, set())
            except RmwError:
                self._taken[kind].discard(endpoint.number)
                raise
            missing.append((self._topics[topic_name][0], self.participant))
        topic, _, users = self._topics[topic_name]
        users.add(endpoint)
        group = ObjectId(1, _GROUP[kind])
        if group.kind not in self._groups:
            self._groups.add(group.kind)
            missing.append((group, self.participant))
        return Plan(endpoint, topic, (*missing, (endpoint, group)))

    def release(self, endpoint: ObjectId) -> list[ObjectId]:
        """Give an endpoint's ids back; the objects to delete, in this order."""
        self._taken[endpoint.kind].discard(endpoint.number)
        released = [endpoint]
        for name, (topic, _, users) in tuple(self._topics.items()):
            users.discard(endpoint)
            if not users:
                del self._topics[name]
                self._taken[Kind.TOPIC].discard(topic.number)
                released.append(topic)
        return released

    def abandon(self, plan: Plan) -> list[ObjectId]:
        """The endpoint could not be made: as if it had never been planned; the objects to delete, in this order."""
        self.release(plan.endpoint)
        planned = [object_id for object_id, _ in plan.missing]
        self._groups.difference_update(object_id.kind for object_id in planned)
        return planned[::-1]

    def _take(self, kind: Kind) -> ObjectId:
        taken = self._taken[kind]
        if len(taken) == len(_NUMBERS):
            raise RmwError(ReturnCode.BAD_ALLOC, f"a session has at most {len(_NUMBERS)} objects of a kind")
        number = next(number for number in _NUMBERS if number not in taken)
        taken.add(number)
        return ObjectId(number, kind)


def topic_body(topic_name: str, type_name: str) -> bytes:
    """A topic in binary form."""
    return encode_binary(TopicBody(topic_name, type_name=type_name))


def endpoint_body(kind: Kind, topic: ObjectId, qos: QosProfile) -> bytes:
    """A data writer or reader in binary form."""
    flags = Qos(0)
    if qos.reliability is Reliability.RELIABLE:
        flags |= Qos.RELIABLE
    if qos.history is History.KEEP_LAST:
        flags |= Qos.KEEP_LAST
    if qos.durability is Durability.TRANSIENT_LOCAL:
        flags |= Qos.TRANSIENT_LOCAL
    told = EndpointQos(flags, depth=qos.depth, deadline_ms=qos.deadline_ms if qos.has_deadline else None)
    return encode_binary(WriterBody(topic, told) if kind is Kind.DATAWRITER else ReaderBody(topic, told))
