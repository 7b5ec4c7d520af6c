"""The reference semantics behind the contract."""
