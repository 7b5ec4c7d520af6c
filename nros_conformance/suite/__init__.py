"""Declarative suites: schema, loader, requirement catalogue."""
