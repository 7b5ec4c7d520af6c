"""The command nros-conformance."""
