from __future__ import annotations

from collections import deque
from collections.abc import Callable

from nros_conformance.rmw.backend import Publisher, Session, Subscription
from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.events import CountStatus, EventCallback
from nros_conformance.rmw.qos import DEFAULT, QosProfile


class QueueSession(Session):
    """Runs what is put into ``ready``, oldest first, and writes down how it is driven. Waits for nothing."""

    def __init__(self) -> None:
        self.ready: deque[Callable[[], object]] = deque()
        self.drives: list[tuple[int, int | None]] = []
        self.code: int = ReturnCode.OK
        self.destroy_code: int = ReturnCode.OK
        self.refuse = ReturnCode.OK

    def create_publisher(self, topic: str, type_name: str, qos: QosProfile) -> Publisher:
        raise RmwError(ReturnCode.INCOMPATIBLE_QOS, "no publishers here")

    def create_subscription(self, topic: str, type_name: str, qos: QosProfile) -> Subscription:
        return PolledSubscription()

    def drive_io(self, timeout_ms: int, max_callbacks: int | None = None) -> int:
        self.drives.append((timeout_ms, max_callbacks))
        for _ in range(len(self.ready) if max_callbacks is None else min(max_callbacks, len(self.ready))):
            self.ready.popleft()()
        return self.code

    def destroy(self) -> int:
        return self.destroy_code

    @property
    def waited_ms(self) -> int:
        return sum(timeout_ms for timeout_ms, _ in self.drives)


class PolledSubscription(Subscription):
    """Cannot announce messages (`set_message_callback` is the default), and answers what it is told to."""

    topic = "/polled"
    type_name = "std_msgs/msg/String"
    qos = DEFAULT

    def __init__(self, *samples: bytes | int) -> None:
        self.samples = deque(samples)
        self.event_code: int = ReturnCode.OK
        self.event: EventCallback | None = None
        self.destroyed = 0

    def supports_event(self, kind: int) -> bool:
        return self.event_code == ReturnCode.OK

    def register_event(self, kind: int, deadline_ms: int, callback: EventCallback | None, context: object) -> int:
        if self.event_code == ReturnCode.OK:
            self.event = callback
        return self.event_code

    def fire(self, total: int, change: int) -> None:
        """An event, of whichever kind was registered last."""
        assert self.event is not None
        self.event(2, CountStatus(total, change), None)

    def has_data(self) -> bool | int:
        return len(self.samples) > 0

    def try_recv_raw(self, max_size: int) -> bytes | int:
        return self.samples.popleft() if self.samples else ReturnCode.NO_DATA

    def destroy(self) -> int:
        self.destroyed += 1
        return ReturnCode.OK
