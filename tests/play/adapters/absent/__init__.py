"""An adapter whose middleware is not installed."""

import middleware_that_is_not_there  # type: ignore[import-not-found]  # noqa: F401
