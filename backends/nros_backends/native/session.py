"""Sessions of a compiled backend."""

from __future__ import annotations

from collections import deque

from nros_backends.native.abi import SessionStruct
from nros_backends.native.callbacks import Registration
from nros_backends.native.entities import NativeEntity, NativePublisher, NativeSubscription, refusal
from nros_backends.native.library import Library
from nros_backends.native.options import MODES
from nros_backends.native.storage import Storage
from nros_conformance.rmw.backend import Publisher, Session, SessionOptions, Subscription
from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.qos import QosProfile

_INT32_MAX = 2**31 - 1


class NativeSession(Session):
    """Calls go straight to the vtable. It goes as the runtime lets it go: its entities first."""

    def __init__(
        self, library: Library, options: SessionOptions, domain: int, released: deque[Registration] | None = None
    ) -> None:
        """Create it. Raises `RmwError`. ``released``: where registrations go whose late calls are told."""
        if options.hard_liveliness_ms:  # while a lease of the connection is the library's own affair
            raise RmwError(ReturnCode.INVALID_CONFIG, "the C boundary does not know hard liveliness")
        self.library = library
        self.domain = domain
        self.node_name = options.node_name
        self.closed = False
        self.entities: list[NativeEntity] = []
        self.released: deque[Registration] = deque(maxlen=0) if released is None else released
        node, space = library.strings.address(options.node_name), library.strings.address("/")
        self.storage = Storage(
            SessionStruct(node_name=node, namespace_=space), library.graveyard,
            fresh=library.options.storage == "fresh",
        )  # fmt: skip
        locator = options.locator or library.options.locator
        create, mode = library.slots["create_session"], MODES[library.options.mode]
        with self.storage.lent() as out, library.callbacks.calls:
            code = create(locator.encode(), mode, domain, node, out)
        if code:
            raise refusal("create_session", code)

    def create_publisher(self, topic: str, type_name: str, qos: QosProfile) -> Publisher:
        return NativePublisher(self, topic, type_name, qos)

    def create_subscription(self, topic: str, type_name: str, qos: QosProfile) -> Subscription:
        return NativeSubscription(self, topic, type_name, qos)

    def drive_io(self, timeout_ms: int, max_callbacks: int | None = None) -> int:
        """The vtable has no cap of callbacks (C08): ``max_callbacks`` changes nothing."""
        if self.closed:
            return ReturnCode.INVALID_ARGUMENT
        drive = self.library.slots["drive_io"]
        with self.storage.lent() as handle, self.library.callbacks.calls:
            return int(drive(handle, max(min(timeout_ms, _INT32_MAX), -_INT32_MAX)))

    def ping(self, timeout_ms: int, attempts: int = 1) -> int:
        """One probe a call of the slot, until one is answered."""
        if self.closed:
            return ReturnCode.INVALID_ARGUMENT
        ping = self.library.slots["ping_session"]
        if ping is None:
            return ReturnCode.UNSUPPORTED
        code: int = ReturnCode.TIMEOUT
        for _ in range(attempts):
            with self.storage.lent() as handle, self.library.callbacks.calls:
                code = int(ping(handle, timeout_ms))
            if code in (ReturnCode.OK, ReturnCode.UNSUPPORTED):
                break
        return code

    def destroy(self) -> int:
        if self.closed:
            return ReturnCode.INVALID_ARGUMENT
        for entity in reversed(self.entities[:]):
            entity.destroy()
        with self.storage.lent() as handle, self.library.callbacks.calls:
            code = int(self.library.slots["destroy_session"](handle))
        self.closed = code != ReturnCode.WOULD_BLOCK
        return code
