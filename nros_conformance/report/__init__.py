"""Verdicts in, tables out. Knows no backend."""
