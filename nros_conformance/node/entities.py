"""Publishers and subscriptions of an application, with the five events as callbacks and as awaits.

Semantics: ``status-events.md`` of the nano-ros book; numbers such as DSP-002 are requirements. All
callbacks run inside ``drive_io``, on the thread that spins. Registering what the backend does not
generate raises `UnsupportedError`; ``supports_event`` says so beforehand.
"""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from datetime import timedelta
from typing import Any, Generic, TypeVar

from nros_conformance.node.channel import Channel, S
from nros_conformance.node.dispatcher import DataCallback, Dispatcher
from nros_conformance.node.errors import raise_for
from nros_conformance.rmw import backend as rmw
from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.events import CountStatus, EventKind, LivelinessChangedStatus
from nros_conformance.rmw.qos import INFINITE_MS, QosProfile, milliseconds

_H = TypeVar("_H", bound=rmw.Entity)


class _Entity(Generic[_H]):
    """What both ends share. ``handle`` is the entity of the contract beneath it."""

    noun: str

    def __init__(self, handle: _H, dispatcher: Dispatcher, forget: Callable[[Any], object]) -> None:
        self.handle = handle
        self._dispatcher = dispatcher
        self._forget = forget
        self._channels: list[Channel[Any]] = []
        self._destroyed = False

    def __str__(self) -> str:
        return f"the {self.noun} {self.topic}"

    @property
    def topic(self) -> str:
        """Its topic, as it was given."""
        return self.handle.topic

    @property
    def qos(self) -> QosProfile:
        """The QoS in force, which the backend may have had to complete."""
        return self.handle.qos

    def supports_event(self, kind: EventKind) -> bool:
        """Whether registering this kind here will work (REG-001)."""
        return self.handle.supports_event(int(kind))

    def destroy(self) -> None:
        """Release it; no callback runs afterwards (DSP-004), awaits end. A second call is harmless."""
        if self._destroyed:
            return
        code = self.handle.destroy()
        self.abandon()
        self._forget(self)
        raise_for(int(code), f"destroying {self}")

    def abandon(self) -> None:
        """Let go of callbacks and awaits: its handle is gone, maybe with its session."""
        self._destroyed = True
        for channel in self._channels:
            channel.close()

    def _channel(self, kind: EventKind, _status: type[S]) -> Channel[S]:
        channel: Channel[S] = Channel(self.handle, kind, str(self), self._dispatcher)
        self._channels.append(channel)
        return channel


class Subscription(_Entity[rmw.Subscription]):
    """The receiving end. Made by `Node.create_subscription`."""

    noun = "subscription to"

    def __init__(
        self, handle: rmw.Subscription, dispatcher: Dispatcher, forget: Callable[[Subscription], object],
        callback: DataCallback | None, max_size: int,
    ) -> None:  # fmt: skip
        super().__init__(handle, dispatcher, forget)
        self._max_size = max_size
        self._liveliness_changed = self._channel(EventKind.LIVELINESS_CHANGED, LivelinessChangedStatus)
        self._deadline_missed = self._channel(EventKind.REQUESTED_DEADLINE_MISSED, CountStatus)
        self._message_lost = self._channel(EventKind.MESSAGE_LOST, CountStatus)
        if callback is not None:
            dispatcher.add_subscription(handle, callback, max_size)

    def on_liveliness_changed(self, callback: Callable[[LivelinessChangedStatus], None]) -> None:
        """A publisher comes or goes; the state of now, too, is told once (REG-009)."""
        self._liveliness_changed.on(callback)

    def on_requested_deadline_missed(self, deadline: timedelta, callback: Callable[[CountStatus], None]) -> None:
        """A sample did not arrive within ``deadline`` of the one before; a fraction of 1 ms rounds up.

        A deadline that the subscription's QoS states takes precedence (C04).
        """
        self._deadline_missed.on(callback, _deadline_ms(deadline))

    def on_message_lost(self, callback: Callable[[CountStatus], None]) -> None:
        """The backend dropped samples: overflow, slow consumer, a gap on the wire."""
        self._message_lost.on(callback)

    def next_liveliness_change(self) -> Coroutine[Any, Any, LivelinessChangedStatus]:
        """Awaitable twin of `on_liveliness_changed`. Events between two awaits are kept, in order."""
        return self._liveliness_changed.next()

    def next_deadline_miss(self, deadline: timedelta | None = None) -> Coroutine[Any, Any, CountStatus]:
        """Awaitable twin of `on_requested_deadline_missed`.

        ``deadline`` is for the first call, when neither QoS nor callback has stated one.
        """
        return self._deadline_missed.next(None if deadline is None else _deadline_ms(deadline))

    def next_message_lost(self) -> Coroutine[Any, Any, CountStatus]:
        """Awaitable twin of `on_message_lost`."""
        return self._message_lost.next()

    def has_data(self) -> bool:
        """Whether `try_recv` would return a sample. Raises `RmwError` once destroyed."""
        answer = self.handle.has_data()
        if not isinstance(answer, bool):
            raise_for(int(answer), f"looking for data of {self}")
        return answer is True

    def try_recv(self) -> bytes | None:
        """The oldest sample, None when there is none.

        Raises `RmwError` BUFFER_TOO_SMALL for one above ``max_size``, INVALID_ARGUMENT once destroyed.
        """
        data = self.handle.try_recv_raw(self._max_size)
        if isinstance(data, bytes):
            return data
        if data != ReturnCode.NO_DATA:
            raise_for(int(data), f"receiving from {self}")
        return None

    def abandon(self) -> None:
        super().abandon()
        self._dispatcher.remove_subscription(self.handle)


class Publisher(_Entity[rmw.Publisher]):
    """The sending end. Made by `Node.create_publisher`."""

    noun = "publisher of"

    def __init__(
        self, handle: rmw.Publisher, dispatcher: Dispatcher, forget: Callable[[Publisher], object]
    ) -> None:  # fmt: skip
        super().__init__(handle, dispatcher, forget)
        self._liveliness_lost = self._channel(EventKind.LIVELINESS_LOST, CountStatus)
        self._deadline_missed = self._channel(EventKind.OFFERED_DEADLINE_MISSED, CountStatus)

    def publish(self, data: bytes) -> None:
        """Send one serialized sample. Raises `RmwError`: MESSAGE_TOO_LARGE, INVALID_ARGUMENT..."""
        raise_for(int(self.handle.publish_raw(data)), f"publishing {len(data)} bytes on {self.topic}")

    def assert_liveliness(self) -> None:
        """Say that this publisher is alive; without effect unless its liveliness is manual (LVL-003)."""
        raise_for(int(self.handle.assert_liveliness()), f"asserting the liveliness of {self}")

    def on_liveliness_lost(self, callback: Callable[[CountStatus], None]) -> None:
        """This publisher did not assert within its own lease, once per loss (LVL-002)."""
        self._liveliness_lost.on(callback)

    def on_offered_deadline_missed(self, deadline: timedelta, callback: Callable[[CountStatus], None]) -> None:
        """This publisher did not publish within ``deadline``; a fraction of 1 ms rounds up.

        A deadline that the publisher's QoS states takes precedence (C04).
        """
        self._deadline_missed.on(callback, _deadline_ms(deadline))

    def next_liveliness_loss(self) -> Coroutine[Any, Any, CountStatus]:
        """Awaitable twin of `on_liveliness_lost`. Events between two awaits are kept, in order."""
        return self._liveliness_lost.next()

    def next_offered_deadline_miss(self, deadline: timedelta | None = None) -> Coroutine[Any, Any, CountStatus]:
        """Awaitable twin of `on_offered_deadline_missed`; ``deadline`` as in `Subscription.next_deadline_miss`."""
        return self._deadline_missed.next(None if deadline is None else _deadline_ms(deadline))


def _deadline_ms(deadline: timedelta) -> int:
    if not isinstance(deadline, timedelta):
        raise TypeError(f"a deadline is a timedelta, such as timedelta(milliseconds=15), not {deadline!r}")
    period_ms = milliseconds(deadline)
    if not 0 <= period_ms <= INFINITE_MS:
        raise RmwError(ReturnCode.INVALID_ARGUMENT, f"the deadline, {period_ms} ms, does not fit u32")
    return period_ms
