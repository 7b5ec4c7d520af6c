"""Entities described in XML, as DDS-XML 1.0 and Fast DDS' profiles write them.

Only what the agent uses is looked at. Namespaces are ignored. A document type declaration is refused,
and with it every kind of entity expansion. Attributes without a space between them are taken, as eProsima's
examples have them.
"""

from __future__ import annotations

import re
from xml.etree import ElementTree

from nros_backends.xrce.agent.descriptions import (
    Description,
    Endpoint,
    Group,
    Participant,
    Refused,
    Service,
    Topic,
    service,
)
from nros_backends.xrce.agent.qos import READER, WRITER, Durability, EntityQos, Liveliness
from nros_backends.xrce.wire.ids import Kind

LONGEST = 1 << 20
"""Characters of the longest document that is parsed."""
SECOND = 1_000_000_000
_TAGS = {
    Kind.PARTICIPANT: ("participant", "domain_participant"),
    Kind.TOPIC: ("topic",),
    Kind.PUBLISHER: ("publisher",),
    Kind.SUBSCRIBER: ("subscriber",),
    Kind.DATAWRITER: ("data_writer",),
    Kind.DATAREADER: ("data_reader",),
    Kind.REQUESTER: ("requester",),
    Kind.REPLIER: ("replier",),
}
_TAG = re.compile(r"<[^<>]*>")
_ATTRIBUTE = re.compile(r"""(=\s*(?:"[^"]*"|'[^']*'))(?=[^\s/?>])""")


def parse(kind: Kind, text: str) -> Description:
    """The entity of ``kind`` in a document. Raises `Refused`.

    A publisher or subscriber may be the empty string, which is what clients send.
    """
    if kind in (Kind.PUBLISHER, Kind.SUBSCRIBER) and not text.strip():
        return Group()
    element = _find(kind, _root(text))
    if kind is Kind.PARTICIPANT:
        return Participant(_text(element, "rtps/name") or _text(element, "name"))
    if kind is Kind.TOPIC:
        return _topic(element)
    if kind in (Kind.PUBLISHER, Kind.SUBSCRIBER):
        names = element.findall("qos/partition/names/name") + element.findall("qos/partition/name/element")
        return Group(tuple((name.text or "").strip() for name in names))
    if kind in (Kind.REQUESTER, Kind.REPLIER):
        return _service(element)
    topic = element.find("topic")
    if topic is None:
        raise Refused(f"{element.tag} without a topic")
    return Endpoint(_topic(topic), _qos(element, topic, WRITER if kind is Kind.DATAWRITER else READER))


def _root(text: str) -> ElementTree.Element:
    if len(text) > LONGEST:
        raise Refused(f"an XML document of {len(text)} characters, {LONGEST} are allowed")
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise Refused("a document type declaration in XML")
    try:
        root = ElementTree.fromstring(_TAG.sub(lambda tag: _ATTRIBUTE.sub(r"\1 ", tag[0]), text))
    except (ElementTree.ParseError, ValueError) as error:  # ValueError: an encoding that it does not have
        raise Refused(f"not XML: {error}") from None
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
    return root


def _find(kind: Kind, root: ElementTree.Element) -> ElementTree.Element:
    tags = _TAGS.get(kind)
    if tags is None:
        raise Refused(f"object kind {kind.name} in XML")
    for element in root.iter():
        if element.tag in tags:
            return element
    raise Refused(f"no <{tags[0]}> in the XML document")


def _text(element: ElementTree.Element, path: str) -> str:
    return (element.findtext(path) or "").strip()


def _topic(element: ElementTree.Element) -> Topic:
    name = _text(element, "name")
    kind = _text(element, "dataType")
    if not name or not kind:
        raise Refused("a topic needs <name> and <dataType>")
    return Topic(name, kind)


def _service(element: ElementTree.Element) -> Service:
    name, request, reply = (element.get(one, "") for one in ("service_name", "request_type", "reply_type"))
    if not (name and request and reply):
        raise Refused(f"a {element.tag} needs service_name, request_type and reply_type")
    return service(
        name, request, reply, READER, _text(element, "request_topic_name"), _text(element, "reply_topic_name")
    )


def _qos(element: ElementTree.Element, topic: ElementTree.Element, default: EntityQos) -> EntityQos:
    history = _text(topic, "historyQos/kind") or "KEEP_LAST"
    depth = _text(topic, "historyQos/depth")
    reliability = _text(element, "qos/reliability/kind")
    return EntityQos(
        reliable=_choice(reliability, ("BEST_EFFORT", "RELIABLE"), int(default.reliable)) == 1,
        durability=Durability(
            _choice(_text(element, "qos/durability/kind"), tuple(Durability.__members__), default.durability)
        ),
        depth=None if history == "KEEP_ALL" else _number(depth) if depth else default.depth,
        deadline_ns=_duration(element.find("qos/deadline/period")),
        lifespan_ns=_duration(element.find("qos/lifespan/duration")),
        liveliness=Liveliness(_choice(_text(element, "qos/liveliness/kind"), tuple(Liveliness.__members__), 0)),
        lease_ns=_duration(element.find("qos/liveliness/lease_duration")),
        exclusive=_text(element, "qos/ownership/kind") == "EXCLUSIVE",
    )


def _choice(text: str, words: tuple[str, ...], default: int) -> int:
    word = text.removesuffix("_RELIABILITY_QOS").removesuffix("_DURABILITY_QOS").removesuffix("_LIVELINESS_QOS")
    if not word:
        return default
    if word not in words:
        raise Refused(f"{text} is none of {', '.join(words)}")
    return words.index(word)


def _number(text: str) -> int:
    if not (text.isascii() and text.isdigit()) or len(text) > 10 or int(text) == 0:
        raise Refused(f"{text!r} is not a positive number")
    return min(int(text), LONGEST)


def _duration(element: ElementTree.Element | None) -> int | None:
    """None: infinite, which is also what an absent element means."""
    if element is None or (element.text or "").strip() == "DURATION_INFINITY":
        return None
    seconds = _text(element, "sec")
    nanoseconds = _text(element, "nanosec") or "0"
    if seconds in ("", "DURATION_INFINITY", "DURATION_INFINITE_SEC") or nanoseconds.startswith("DURATION_INF"):
        return None
    if not all(part.isascii() and part.isdigit() and len(part) <= 10 for part in (seconds, nanoseconds)):
        raise Refused(f"{seconds!r} seconds {nanoseconds!r} nanoseconds are not a duration")
    return int(seconds) * SECOND + int(nanoseconds)
