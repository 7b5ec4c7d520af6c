"""Publishers and subscriptions of a compiled backend."""

from __future__ import annotations

import ctypes as ct
from typing import TYPE_CHECKING

from nros_backends.native.abi import EntityStruct, EventFunction, PublisherOptions, Qos, SubscriptionOptions
from nros_backends.native.callbacks import Registration
from nros_backends.native.storage import Storage
from nros_conformance.rmw.backend import Entity, Publisher, Subscription
from nros_conformance.rmw.codes import ReturnCode, RmwError, code_name
from nros_conformance.rmw.events import EventCallback, EventKind, Side
from nros_conformance.rmw.qos import INFINITE_MS, QosProfile

if TYPE_CHECKING:
    from nros_backends.native.session import NativeSession

TYPE_HASH = "RIHS01_" + "0" * 64
"""Of a type that nobody knows: the suites' messages exist nowhere else."""

_CANARY = b"\xc5" * 16
_INT32_MAX = 2**31 - 1


def refusal(slot: str, code: int) -> Exception:
    """What creating raises for a negative answer; a code that nobody published is a fault of its own."""
    try:
        return RmwError(ReturnCode(code), f"{slot} answered {code_name(code)}")
    except ValueError:
        return RuntimeError(f"{slot} answered {code_name(code)}")


class NativeEntity(Entity):
    """What both ends share. The structs and names stay allocated when it is destroyed, as C may still look."""

    side: Side

    def __init__(self, session: NativeSession, topic: str, type_name: str, qos: QosProfile) -> None:
        """Create it. Raises `RmwError`."""
        qos.check()
        if session.closed:
            raise RmwError(ReturnCode.INVALID_ARGUMENT, "the session is destroyed")
        self.session = session
        self.library = library = session.library
        self.topic, self.type_name, self.qos = topic, type_name, qos
        self.destroyed = False
        self._registered: dict[int, Registration] = {}
        """Those in force, by kind."""
        try:
            names = (library.strings.address(topic), library.strings.address(type_name))
        except ValueError as error:
            raise RmwError(ReturnCode.TOPIC_NAME_INVALID, str(error)) from error
        if library.topic_hook is not None and (code := library.topic_hook(topic.encode(), type_name.encode())) < 0:
            raise refusal("the topic hook", code)
        self._qos = Qos(
            reliability=qos.reliability, durability=qos.durability, history=qos.history, depth=qos.depth,
            liveliness_kind=qos.liveliness, deadline_ms=qos.deadline_ms, lifespan_ms=qos.lifespan_ms,
            liveliness_lease_ms=qos.lease_ms, avoid_ros_namespace_conventions=qos.avoid_ros_namespace_conventions,
        )  # fmt: skip
        struct = EntityStruct(topic_name=names[0], type_name=names[1], qos=self._qos)
        self.storage = Storage(struct, library.graveyard, fresh=library.options.storage == "fresh")
        self._options: ct.Structure = PublisherOptions() if self.side is Side.PUBLISHER else SubscriptionOptions()
        slot = f"create_{self.side.value}"
        type_hash = library.strings.address(TYPE_HASH)
        with session.storage.lent() as of, self.storage.lent() as out, library.callbacks.calls:
            code = library.slots[slot](
                of, *names, ct.c_char_p(type_hash), session.domain, ct.addressof(self._qos),
                ct.addressof(self._options), out,
            )  # fmt: skip
        if code:
            raise refusal(slot, code)
        session.entities.append(self)

    def supports_event(self, kind: int) -> bool:
        """As the survey of the library derived it from what registering answered: C has no such question."""
        return kind in self.library.options.supports and EventKind(kind).side is self.side

    def register_event(self, kind: int, deadline_ms: int, callback: EventCallback | None, context: object) -> int:
        if self.destroyed:  # in C its memory is gone: the runtime cannot ask any more
            return ReturnCode.INVALID_ARGUMENT
        if not (-_INT32_MAX <= kind <= _INT32_MAX and 0 <= deadline_ms <= INFINITE_MS):
            return ReturnCode.INVALID_ARGUMENT
        slot = f"register_{self.side.value}_event"
        if self.library.slots[slot] is None:
            return ReturnCode.UNSUPPORTED
        made = None if callback is None else self.library.callbacks.make(kind, callback, context)
        function, user = (EventFunction(), 0) if made is None else (made.function.pointer, made.pointer)
        with self.storage.lent() as handle, self.library.callbacks.calls:
            code = int(self.library.slots[slot](handle, kind, deadline_ms, function, user))
            if made is not None and code == ReturnCode.OK and not self.destroyed:
                self._release(self._registered.pop(kind, None))
                self._registered[kind] = made
            else:
                self._release(made)
        return code

    def _release(self, *registrations: Registration | None) -> None:
        """C has no unregister: the adapter lets go, and remembers for a while whose a late call would be."""
        for one in registrations:
            if one is not None:
                self.library.callbacks.release(one)
                self.session.released.append(one)

    def destroy(self) -> int:
        if self.destroyed:
            return ReturnCode.INVALID_ARGUMENT
        self.destroyed = True
        self.session.entities.remove(self)
        try:
            with self.storage.lent() as handle, self.library.callbacks.calls:
                self.library.slots[f"destroy_{self.side.value}"](handle)
        finally:
            self._release(*self._registered.values())
            self._registered.clear()
        return ReturnCode.OK


class NativePublisher(NativeEntity, Publisher):
    """The sending end."""

    side = Side.PUBLISHER

    def publish_raw(self, data: bytes) -> int:
        if self.destroyed:
            return ReturnCode.INVALID_ARGUMENT
        with self.storage.lent() as handle, self.library.callbacks.calls:
            return int(self.library.slots["publish_raw"](handle, ct.cast(ct.c_char_p(data), ct.c_void_p), len(data)))

    def assert_liveliness(self) -> int:
        """A NULL slot answers UNSUPPORTED, whatever the kind, as the runtime does (C16)."""
        if self.destroyed:
            return ReturnCode.INVALID_ARGUMENT
        if self.library.slots["assert_publisher_liveliness"] is None:
            return ReturnCode.UNSUPPORTED
        with self.storage.lent() as handle, self.library.callbacks.calls:
            return int(self.library.slots["assert_publisher_liveliness"](handle))


class NativeSubscription(NativeEntity, Subscription):
    """The receiving end."""

    side = Side.SUBSCRIPTION

    def has_data(self) -> bool | int:
        if self.destroyed:
            return ReturnCode.INVALID_ARGUMENT
        with self.storage.lent() as handle, self.library.callbacks.calls:
            code = int(self.library.slots["has_data"](handle))
        return code if code < 0 else code > 0

    def try_recv_raw(self, max_size: int) -> bytes | int:
        """Raises RuntimeError when the backend wrote, or says that it wrote, more than there was room for."""
        if self.destroyed or max_size < 0:
            return ReturnCode.INVALID_ARGUMENT
        buffer = ct.create_string_buffer(bytes(max_size) + _CANARY, max_size + len(_CANARY))
        with self.storage.lent() as handle, self.library.callbacks.calls:
            code = int(self.library.slots["try_recv_raw"](handle, ct.addressof(buffer), max_size))
        if code > max_size or not buffer.raw.endswith(_CANARY):
            raise RuntimeError(f"try_recv_raw wrote beyond its buffer of {max_size} bytes, and answered {code}")
        return code if code < 0 else buffer.raw[:code]
