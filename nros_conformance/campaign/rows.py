"""From a backend that was found to the rows that it plays, with an author's own list of known failures."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path

import msgspec

from nros_conformance.campaign.plans import Row
from nros_conformance.formats.places import nearest
from nros_conformance.formats.toml import read_toml
from nros_conformance.rmw.backend import Host
from nros_conformance.rmw.clock import MonotonicClock
from nros_conformance.rmw.declaration import Declaration, KnownFile, check_links
from nros_conformance.rmw.discovery import BackendNotFound, Found, find_backend, find_backends
from nros_conformance.suite.loader import Suites


def find_rows(name: str) -> Found:
    """A backend, or one of its rows: ``zenoh``, ``zenoh-peer``, ``module:Class``. Raises `BackendNotFound`."""
    backends = find_backends()
    first, colon, _ = name.partition(":")
    if colon and first in backends and (declaration := backends[first].declaration) and declaration.variants:
        rows = ", ".join(f"{first}-{variant}" for variant in declaration.variants)
        raise BackendNotFound(f"no backend {name!r}; rows of {first} are {rows} (MODULE:CLASS names an adapter)")
    for found in backends.values():
        variant = name.removeprefix(f"{found.name}-")
        if found.declaration is not None and variant != name and variant in found.declaration.variants:
            only = {variant: {**found.declaration.variants[variant], "default": True}}
            return dataclasses.replace(found, declaration=msgspec.structs.replace(found.declaration, variants=only))
    return find_backend(name)


def rows_of(
    found: Found, declaration: Declaration, asked: str = "", options: Mapping[str, str] | None = None
) -> list[Row]:
    """One row for each default variant. ``asked``: the name, or options, by which the backend is found again.

    ``options`` are for the adapter. Raises ImportError when its middleware is missing, `RmwError` when it refuses
    the options, `FormatError` when it is broken.
    """
    given = {**found.options, **(options or {})}
    host = Host(clock=MonotonicClock(), options=given)
    versions = found.versions(host)
    variants = [name for name, facts in declaration.variants.items() if facts.get("default", True)]
    return [
        Row(
            declaration.in_variant(variant), found.adapter, variant, versions, given,
            found.lacking(dataclasses.replace(host, variant=variant)), asked=asked, provisional=found.provisional,
        )
        for variant in variants or [""]
    ]  # fmt: skip


def with_known(declaration: Declaration, file: Path, suites: Suites) -> Declaration:
    """The declaration with the ``[[known]]`` entries of a file added to its own.

    Raises `FormatError`: at an entry that names a scenario or requirement that does not exist, or one without a link.
    """
    document = read_toml(file)
    entries = document.read(KnownFile).known
    check_links(document, entries)
    ids = {one.scenario.id for one in suites.scenarios}
    keys = {one.key for one in suites.scenarios}
    for index, known in enumerate(entries):
        if known.scenario not in ids | keys:
            hint = nearest(known.scenario, sorted(ids))
            raise document.error(
                ("known", index, "scenario"), f"known {known.key}: no scenario {known.scenario!r}",
                hint if hint.startswith("did you mean") else "see: nros-conformance list scenarios",
            )  # fmt: skip
        if known.requirement not in suites.levels:
            raise document.error(
                ("known", index, "requirement"), f"known {known.key}: no requirement {known.requirement!r}",
                "see: nros-conformance list requirements",
            )  # fmt: skip
    return msgspec.structs.replace(declaration, known=[*declaration.known, *entries])
