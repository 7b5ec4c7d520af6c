"""The entities of one client: creation modes, references, and their place in the exchange."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from nros_backends.xrce.agent.descriptions import Description, Endpoint, Group, Refused, Service, Topic
from nros_backends.xrce.agent.exchange import DataReader, DataWriter, Exchange, TopicKey
from nros_backends.xrce.agent.qos import WRITER
from nros_backends.xrce.agent.representations import describe
from nros_backends.xrce.agent.services import Replier, Requester
from nros_backends.xrce.wire.cdr import Malformed
from nros_backends.xrce.wire.ids import Kind, ObjectId, Status
from nros_backends.xrce.wire.messages import Create

LIMIT = 1024
"""Entities of one client; one more is refused with RESOURCES."""
PARENTS = {
    Kind.TOPIC: Kind.PARTICIPANT,
    Kind.PUBLISHER: Kind.PARTICIPANT,
    Kind.SUBSCRIBER: Kind.PARTICIPANT,
    Kind.DATAWRITER: Kind.PUBLISHER,
    Kind.DATAREADER: Kind.SUBSCRIBER,
    Kind.REQUESTER: Kind.PARTICIPANT,
    Kind.REPLIER: Kind.PARTICIPANT,
}


class Entity:
    """An entity that exists. ``endpoint``: the place of one that writes or reads in the exchange."""

    def __init__(self, identifier: ObjectId, description: Description, domain: int) -> None:
        self.id = identifier
        self.description = description
        self.domain = domain
        self.endpoint: DataWriter | DataReader | Requester | Replier | None = None


class Entities:
    """Everything that one client created.

    As in eProsima's agent an entity lives until it or its client is deleted: a writer goes on
    without its publisher and its topic.
    """

    def __init__(self, exchange: Exchange, profiles: Mapping[tuple[Kind, str], Description]) -> None:
        self._exchange = exchange
        self._profiles = profiles
        self._entities: dict[ObjectId, Entity] = {}

    def __iter__(self) -> Iterator[Entity]:
        return iter(self._entities.values())

    def __contains__(self, identifier: object) -> bool:
        return identifier in self._entities

    def create(self, request: Create) -> Status:
        """Create, reuse or replace an entity, as its flags say; what to answer (table 7 of the specification)."""
        identifier = ObjectId(request.object.number, request.kind)
        if request.kind is not Kind.PARTICIPANT and request.kind not in PARENTS:
            return Status.INCOMPATIBLE
        existing = self._entities.get(identifier)
        if existing is not None and not (request.reuse or request.replace):
            return Status.ALREADY_EXISTS
        if existing is not None and request.reuse:
            try:
                same = describe(request, self._profiles) == existing.description
            except (Refused, Malformed):
                same = False
            if same:
                return Status.OK_MATCHED
            if not request.replace:
                return Status.MISMATCH
        if existing is not None:
            self.delete(identifier)
        return self._create(identifier, request)

    def delete(self, identifier: ObjectId) -> Status:
        """Delete an entity; what to answer."""
        entity = self._entities.pop(identifier, None)
        if entity is None:
            return Status.UNKNOWN_REFERENCE
        match entity.endpoint:
            case DataWriter() | DataReader() as endpoint:
                self._exchange.remove(endpoint)
            case Requester() | Replier() as service:
                self._exchange.remove(service.writer)
                self._exchange.remove(service.reader)
        return Status.OK

    def clear(self) -> None:
        """Delete everything: the client is gone."""
        for identifier in list(self._entities):
            self.delete(identifier)

    def write(self, identifier: ObjectId, request: int, data: bytes, now_ns: int) -> bool:
        """Carry what a writer, a requester or a replier sends; False: there is none, or that is no reply."""
        entity = self._entities.get(identifier)
        match entity.endpoint if entity is not None else None:
            case DataWriter() as writer:
                self._exchange.write(writer, data, now_ns)
                return True
            case Requester() | Replier() as service:
                return service.write(self._exchange, request, data, now_ns)
        return False

    def reader(self, identifier: ObjectId) -> DataReader | None:
        """The reader of an id: a data reader, or that of a requester or replier."""
        entity = self._entities.get(identifier)
        match entity.endpoint if entity is not None else None:
            case DataReader() as reader:
                return reader
            case Requester() | Replier() as service:
                return service.reader
        return None

    def _create(self, identifier: ObjectId, request: Create) -> Status:
        domain, parent = request.domain, None
        if request.parent is not None:
            parent = self._entities.get(ObjectId(request.parent.number, PARENTS[request.kind]))
            if parent is None:
                return Status.UNKNOWN_REFERENCE
            domain = parent.domain
        if len(self._entities) >= LIMIT:
            return Status.RESOURCES
        try:
            description = describe(request, self._profiles)
        except Refused:
            return Status.DDS_ERROR
        except Malformed:
            return Status.INVALID_DATA
        entity = Entity(identifier, description, domain)
        if isinstance(description, Endpoint):
            topic = self._topic(description.topic, domain)
            if topic is None:
                return Status.DDS_ERROR
            partitions = parent.description.partitions if parent and isinstance(parent.description, Group) else ()
            self._join(entity, description, TopicKey(domain, topic.name, topic.type), partitions)
        elif isinstance(description, Service):
            self._serve(entity, description, domain)
        self._entities[identifier] = entity
        return Status.OK

    def _topic(self, wanted: ObjectId | Topic, domain: int) -> Topic | None:
        """The client's own topic in this domain: by id, or by equal name and type."""
        for entity in self:
            if not isinstance(entity.description, Topic) or entity.domain != domain:
                continue
            if isinstance(wanted, Topic):
                if entity.description == wanted:
                    return wanted
            elif entity.id.number == wanted.number:
                return entity.description
        return None

    def _join(self, entity: Entity, endpoint: Endpoint, topic: TopicKey, partitions: tuple[str, ...]) -> None:
        if entity.id.kind is Kind.DATAWRITER:
            writer = DataWriter(topic, endpoint.qos, partitions)
            self._exchange.add_writer(writer)
            entity.endpoint = writer
        else:
            reader = DataReader(topic, endpoint.qos, partitions)
            self._exchange.add_reader(reader)
            entity.endpoint = reader

    def _serve(self, entity: Entity, service: Service, domain: int) -> None:
        request, reply = (TopicKey(domain, topic.name, topic.type) for topic in (service.request, service.reply))
        make = Requester if entity.id.kind is Kind.REQUESTER else Replier
        entity.endpoint = made = make(entity.id, request, reply, (WRITER, service.reader))
        self._exchange.add_writer(made.writer)
        self._exchange.add_reader(made.reader)
