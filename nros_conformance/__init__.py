"""Conformance tests for nano-ros middleware backends: suites, runner, judge, support table."""

__version__ = "0.1.0"
