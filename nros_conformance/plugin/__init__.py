"""Suites as pytest items in the repository of a backend's author. `nros_conformance.pytest_plugin` brings it in."""
