from __future__ import annotations

from hypothesis import HealthCheck, settings


def pytest_configure() -> None:
    """Hypothesis looks for wrong results; on a busy host its own clocks would find slow ones."""
    settings.register_profile("any-host", deadline=None, suppress_health_check=[HealthCheck.too_slow])
    settings.load_profile("any-host")
