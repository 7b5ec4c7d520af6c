"""The loader of compiled backends, entry point ``native`` of the group ``nros_conformance.loaders``."""

from __future__ import annotations

from msgspec.structs import replace

from nros_backends.native.draft import ADAPTER, draft
from nros_backends.native.layout import check_headers
from nros_backends.native.options import Options
from nros_backends.native.survey import Answers
from nros_backends.native.surveyor import supported, survey
from nros_conformance.rmw.declaration import Declaration, load_declaration
from nros_conformance.rmw.discovery import Found
from nros_conformance.rmw.loading import LibraryError, LibraryRequest, Loaded

DERIVED = "its claims are derived from return codes, not declared"


def load_library(request: LibraryRequest) -> Loaded:
    """Look at the library in a process of its own. Raises `LibraryError`; `FormatError` for a declaration."""
    if not request.file.is_file():
        raise LibraryError(f"--native {request.file}: there is no such file")
    checked = [check_headers(request.headers)] if request.headers else []
    options = Options(
        library=str(request.file.absolute()), name=request.name, locator=request.locator, mode=request.mode,
        domain=request.domain, host_libraries=tuple(str(file.absolute()) for file in request.host_libraries),
        topic_hook=request.topic_hook, storage=request.storage,
    )  # fmt: skip
    answers, crashes = survey(options)
    options = supported(answers, options)
    text = draft(answers, request.file.name)
    if request.declaration is None:
        declaration = load_declaration(request.file.with_suffix(".toml"), text)
    else:
        declaration = load_declaration(request.declaration)
    checked.append(answers.vtable)
    found = Found(
        name=declaration.name,
        adapter=ADAPTER,
        declaration=_as_c_is(declaration, request.sessions),
        origin=str(request.declaration or request.file),
        options=options.texts(),
        provisional="" if request.declaration else DERIVED,
    )
    return Loaded(found, (*_says(request, answers, declaration, "; ".join(checked)), *crashes), text)


def _as_c_is(declaration: Declaration, sessions: int) -> Declaration:
    """What the C boundary decides by itself, whatever is declared: no cap, no supports_event."""
    behaviour = replace(declaration.behaviour, derived_support=True, callback_cap=False, clock="real")
    bounds = replace(declaration.bounds, sessions=sessions or declaration.bounds.sessions)
    return replace(
        declaration, behaviour=behaviour, bounds=bounds, subject=replace(declaration.subject, kind="compiled")
    )


def _says(request: LibraryRequest, answers: Answers, declaration: Declaration, checked: str) -> list[str]:
    lines = [
        f"{answers.name!r} of {request.file.name}, registered by {answers.registered_by}; "
        f"{len(answers.null_slots)} optional slots are NULL",
        f"layout: {checked}",
        f"structs: {'a fresh copy in every call' if request.storage == 'fresh' else 'the same in every call'}",
        "callbacks: C has no unregister; LIF-003 is kept by the adapter, which lets go, and who calls later fails "
        "DSP-004",
    ]
    if declaration.behaviour.two_sessions == "second_fails":
        lines.append(
            "a second session in a process fails, so scenarios with two stay untested; "
            "if their number is set when it is built, build it with room for 8"
        )
    elif not request.sessions:
        pairs = declaration.bounds.sessions // 2
        lines.append(f"at once: {pairs} scenarios of two sessions each; more with --sessions N, if it can")
    if request.declaration is None:
        claims = ", ".join(f"{label} {claim}" for label, claim in declaration.claims().items())
        lines.append(f"derived from return codes: {claims}; for claims of yours: --declaration FILE, see declare")
    return lines
