"""What a worker has to know to load a library, as the texts that `Host.options` carries."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping

MODES = {"client": 0, "peer": 1}


@dataclasses.dataclass(frozen=True, slots=True)
class Options:
    """The fields of `LibraryRequest` that a worker needs, and what the survey found to be supported."""

    library: str
    name: str = ""
    locator: str = ""
    mode: str = "client"
    domain: int = 0
    host_libraries: tuple[str, ...] = ()
    topic_hook: str = ""
    storage: str = "fresh"
    supports: frozenset[int] = frozenset()
    """Kinds whose registration answered OK."""

    def texts(self) -> dict[str, str]:
        """For `Host.options`."""
        plain = {name: str(getattr(self, name)) for name in ("library", "name", "locator", "mode", "topic_hook")}
        return plain | {
            "domain": str(self.domain),
            "host_libraries": os.pathsep.join(self.host_libraries),
            "storage": self.storage,
            "supports": ",".join(str(kind) for kind in sorted(self.supports)),
        }

    @classmethod
    def read(cls, texts: Mapping[str, str]) -> Options:
        """Of `Host.options`. Raises KeyError without a library."""
        return cls(
            library=texts["library"],
            name=texts.get("name", ""),
            locator=texts.get("locator", ""),
            mode=texts.get("mode", "client"),
            domain=int(texts.get("domain", "0")),
            host_libraries=tuple(filter(None, texts.get("host_libraries", "").split(os.pathsep))),
            topic_hook=texts.get("topic_hook", ""),
            storage=texts.get("storage", "fresh"),
            supports=frozenset(int(kind) for kind in texts.get("supports", "").split(",") if kind),
        )
