"""Scenario and backend in, trace out. Knows no verdict."""
