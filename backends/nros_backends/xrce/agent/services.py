"""Services, as eProsima has them: requests travel on one topic, replies on another one.

A sample of either topic is known by its writer and its number there, 24 octets that DDS calls its identity. A
replier gets them in front of a request and puts them in front of the reply; the requester gets the request id with
which it asked in front of that. It all is in the data, not in the protocol.
"""

from __future__ import annotations

from nros_backends.xrce.agent.exchange import IDENTITY, DataReader, DataWriter, Exchange, Identity, Sample, TopicKey
from nros_backends.xrce.agent.qos import EntityQos
from nros_backends.xrce.wire.cdr import Writer
from nros_backends.xrce.wire.fields import write_request
from nros_backends.xrce.wire.ids import ObjectId

OPEN = 1024
"""Requests of one requester that wait for their reply; beyond it the oldest waits no more."""


class Requester:
    """Asks, and gets the first reply to each of its requests. ``reader`` gives them out."""

    def __init__(
        self, identifier: ObjectId, request: TopicKey, reply: TopicKey, qos: tuple[EntityQos, EntityQos]
    ) -> None:
        self.writer = DataWriter(request, qos[0], ())
        self.reader = ReplyReader(self.writer, identifier, reply, qos[1])

    def write(self, exchange: Exchange, request: int, data: bytes, now_ns: int) -> bool:
        """Carry a request to the repliers. ``request``: the id that its reply comes back with."""
        self.reader.asked[self.writer.number + 1] = request
        if len(self.reader.asked) > OPEN:
            del self.reader.asked[next(iter(self.reader.asked))]
        exchange.write(self.writer, data, now_ns)
        return True


class Replier:
    """Gets requests, and answers them. ``reader`` gives them out."""

    def __init__(
        self, identifier: ObjectId, request: TopicKey, reply: TopicKey, qos: tuple[EntityQos, EntityQos]
    ) -> None:
        self.writer = DataWriter(reply, qos[0], ())
        self.reader = RequestReader(request, qos[1], ())

    def write(self, exchange: Exchange, request: int, data: bytes, now_ns: int) -> bool:
        """Carry a reply to the requester that its identity names; False: it has none."""
        identity = Identity.of(data)
        if identity is None:
            return False
        exchange.write(self.writer, data[IDENTITY:], now_ns, identity)
        return True


class ReplyReader(DataReader):
    """Takes what answers a request of its own that has no answer yet."""

    def __init__(self, writer: DataWriter, identifier: ObjectId, topic: TopicKey, qos: EntityQos) -> None:
        super().__init__(topic, qos, ())
        self.asked: dict[int, int] = {}
        """Request ids by the number of the request's sample."""
        self._writer = writer
        self._object = identifier

    def put(self, sample: Sample) -> None:
        related = sample.related
        if related is None or related.writer != self._writer.guid:
            return
        request = self.asked.pop(related.number, None)
        if request is not None:
            front = Writer()
            write_request(front, request, self._object)
            super().put(sample._replace(data=bytes(front.data) + sample.data))


class RequestReader(DataReader):
    """Gives requests with the identity that their reply has to name."""

    def put(self, sample: Sample) -> None:
        super().put(sample._replace(data=sample.identity.octets() + sample.data))
