"""A thread that takes samples as they arrive, for deadlines that only the shim can watch.

A period is measured at reception (RDM-005), and DDS does not say when it received a sample. Taken
inside `drive_io`, a sample would look as late as the application is; so for a subscription whose
deadline came with the registration this thread takes it, and notes the time. It calls nothing of the
application's.
"""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

from cyclonedds.core import GuardCondition, InstanceState, ReadCondition, SampleState, ViewState, WaitSet
from cyclonedds.domain import DomainParticipant
from cyclonedds.util import duration

from nros_backends.cyclone.subscription import CycloneSubscription

if TYPE_CHECKING:
    from nros_backends.cyclone.session import CycloneSession

_ANY = SampleState.Any | ViewState.Any | InstanceState.Any


class Receiver:
    """The thread of one session; it ends with `stop`."""

    def __init__(self, session: CycloneSession, participant: DomainParticipant) -> None:
        self._session = session
        self._conditions: dict[CycloneSubscription, ReadCondition] = {}
        self._waitset = WaitSet(participant)
        self._guard = GuardCondition(participant)
        self._waitset.attach(self._guard)
        self._stopped = False
        self._thread = threading.Thread(target=self._run, name="cyclone-receiver", daemon=True)
        self._thread.start()

    def watch(self, subscription: CycloneSubscription) -> None:
        """Take its samples from now on."""
        if subscription not in self._conditions and subscription.reader is not None:
            condition = ReadCondition(subscription.reader, _ANY)
            self._conditions = {**self._conditions, subscription: condition}
            self._waitset.attach(condition)

    def forget(self, subscription: CycloneSubscription) -> None:
        """Leave it alone again, before its reader goes."""
        rest = dict(self._conditions)
        condition = rest.pop(subscription, None)
        self._conditions = rest
        if condition is not None:
            self._waitset.detach(condition)

    def stop(self) -> None:
        """End the thread and wait for it."""
        self._stopped = True
        self._guard.set(True)
        self._thread.join()

    def _run(self) -> None:
        while not self._stopped:
            self._waitset.wait(duration(infinite=True))
            fetched = [subscription.fetch() for subscription in self._conditions]
            if any(fetched):
                self._session.note()
