"""The application API: executor, entities with callbacks."""
