"""Trace in, verdict out. Pure; touches no backend."""
