"""The reference semantics, pure."""
