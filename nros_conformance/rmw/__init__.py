"""The contract: events, return codes, QoS, backend classes, declaration, detection pieces, clock, discovery."""
