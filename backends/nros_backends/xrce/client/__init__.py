"""A DDS-XRCE client: sans-I/O core, UDP transport, health of the agent."""
