"""The pytest plugin's front door: options and nothing else, until a backend is asked for.

pytest loads it in every project of an environment that has nros-conformance, so it imports nothing of
ours before ``--nros-backend``, the ini option ``nros_backends`` or a conftest's ``nros_backend`` names one.
"""

from __future__ import annotations

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    """Options and ini options, all called ``nros``."""
    group = parser.getgroup("nros-conformance", "conformance suites of nano-ros middleware backends")
    group.addoption(
        "--nros-backend", action="append", default=[], metavar="NAME",
        help="play the suites on this backend, module:Class or installed, as tests",
    )  # fmt: skip
    group.addoption(
        "--nros-profile", choices=["smoke", "standard", "publish"], help="default: ini option nros_profile, standard"
    )
    group.addoption("--nros-known", metavar="FILE", help="[[known]] entries of your own; default: ini nros_known")
    group.addoption(
        "--nros-max-unclear", type=int, default=0, metavar="N",
        help="exit 8 if more than N scenarios stay unclear (default 0)",
    )  # fmt: skip
    group.addoption(
        "--nros-results", default=".nros-conformance", metavar="DIR",
        help="where reports and traces go, for nros-conformance explain and matrix (default .nros-conformance)",
    )  # fmt: skip
    group.addoption("--nros-suites", metavar="DIR", help="suite files to use instead of the built-in ones")
    parser.addini("nros_backends", "backends to play the suites on, as by --nros-backend", type="args", default=[])
    parser.addini("nros_profile", "smoke, standard or publish", default="standard")
    parser.addini("nros_known", "file with [[known]] entries", default="")


def pytest_configure(config: pytest.Config) -> None:
    """Bring in the rest if a backend is named: by the option, by the ini option, or by a conftest."""
    named: list[str] = config.getoption("--nros-backend")
    asked = [*named, *config.getini("nros_backends"), *_named_in_conftests(config)]
    if asked:
        from nros_conformance.plugin.session import begin

        begin(config, list(dict.fromkeys(asked)), explicit=bool(named))


def _named_in_conftests(config: pytest.Config) -> list[str]:
    """``nros_backend = "mypackage:MyBackend"`` in a conftest.py, or a list of them."""
    found: list[str] = []
    for plugin in config.pluginmanager.get_plugins():
        if str(getattr(plugin, "__file__", "")).endswith("conftest.py"):
            value = getattr(plugin, "nros_backend", [])
            found += [value] if isinstance(value, str) else value
    return found
