"""Rate-limited reading (``uORB::SubscriptionInterval``): it skips samples on purpose, which is no loss."""

from __future__ import annotations

from nros_backends.uorb.bus import Subscription


class SubscriptionInterval:
    """A subscription that is updated at most once per interval. All times in microseconds, as in PX4."""

    def __init__(self, subscription: Subscription, interval_us: int = 0) -> None:
        self.subscription = subscription
        self.interval_us = interval_us
        self.last_update_us = 0

    def updated(self, now_us: int) -> bool:
        """Whether the interval is over and something is unread."""
        return (
            self.subscription.advertised
            and now_us - self.last_update_us >= self.interval_us
            and self.subscription.updated()
        )

    def update(self, now_us: int) -> bytes | None:
        """`copy` if `updated`."""
        return self.copy(now_us) if self.updated(now_us) else None

    def copy(self, now_us: int) -> bytes | None:
        """Copy whatever the interval says, and move the last update on by one interval.

        It never falls back further than one interval. While the clock is still below the interval
        it is set to now, because PX4's times are unsigned.
        """
        data = self.subscription.copy()
        if data is not None:
            if now_us > self.interval_us:
                moved = self.last_update_us + self.interval_us
                self.last_update_us = min(max(moved, now_us - self.interval_us), now_us)
            else:
                self.last_update_us = now_us
        return data
