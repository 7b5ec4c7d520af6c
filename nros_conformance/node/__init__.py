"""The application API of the seed documents, in Python dress: executor, entities with callbacks."""
