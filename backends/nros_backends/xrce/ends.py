"""What publishers and subscriptions have in common: their objects at the agent, events, the deadline clock."""

from __future__ import annotations

from typing import TYPE_CHECKING

from nros_conformance.rmw.clock import MS
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.ends import ClockedEnd
from nros_conformance.rmw.qos import QosProfile

if TYPE_CHECKING:
    from nros_backends.xrce.session import XrceSession
    from nros_backends.xrce.wire.ids import ObjectId


class End(ClockedEnd):
    """One data writer or data reader. ``missed`` counts missed deadlines, by the client's clock."""

    def __init__(self, session: XrceSession, topic: str, type_name: str, qos: QosProfile, object_id: ObjectId) -> None:
        super().__init__(session.clock, session.queue, topic, type_name, qos, {})
        self.session = session
        self.object_id = object_id
        if qos.has_deadline:
            self._time(qos.deadline_ms * MS)

    def destroy(self) -> int:
        """OK; TIMEOUT when the agent did not confirm; INVALID_ARGUMENT, and no harm, the second time."""
        if self.closed:
            return ReturnCode.INVALID_ARGUMENT
        self.registry.close()
        return self.session.remove(self)
