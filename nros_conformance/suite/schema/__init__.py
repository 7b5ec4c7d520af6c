"""The suite format, version 1, as types. The JSON Schema (`jsonschema`) is generated from them.

A step or an expectation is a mapping whose *head*, its first word, says what it is; `STEPS`, `DOINGS`,
`GIVENS` and `EXPECTATIONS` list the heads. Fields that name Python keywords end in ``_`` here only.
"""

from __future__ import annotations

from nros_conformance.suite.schema.cast import Entity, Qos, Session
from nros_conformance.suite.schema.expectations import (
    EXPECTATIONS,
    Admitted,
    Agrees,
    AnyExpectation,
    AnyOf,
    Callback,
    Callbacks,
    Conserved,
    Counted,
    Cycles,
    Expectation,
    Inside,
    Level,
    Measured,
    Never,
    Periodic,
    Received,
    Returns,
    Takes,
    Total,
)
from nros_conformance.suite.schema.givens import GIVENS, AnyGiven, DrivenGiven, GapGiven, ReceivedGiven, ReturnsGiven
from nros_conformance.suite.schema.scenario import Needs, Scale, Scenario, SuiteFile
from nros_conformance.suite.schema.steps import (
    DOINGS,
    STEPS,
    AnyStep,
    Assert,
    Call,
    Create,
    Cycle,
    Destroy,
    Doing,
    Drive,
    Fault,
    HasData,
    Idle,
    Measure,
    Parallel,
    Phase,
    Ping,
    Publish,
    Quantity,
    Raise,
    Reaction,
    Register,
    Released,
    Repeat,
    Repeated,
    Settle,
    Spin,
    Step,
    Supports,
    Take,
    Until,
)
from nros_conformance.suite.schema.words import (
    PROFILES,
    Base,
    EntityName,
    EntityNames,
    FaultName,
    Identifier,
    KindName,
    KindOrAny,
    Labels,
    Profile,
    RequirementId,
    ScenarioId,
)

__all__ = [
    "DOINGS", "EXPECTATIONS", "GIVENS", "PROFILES", "STEPS", "Admitted", "Agrees", "AnyExpectation", "AnyGiven",
    "AnyOf", "AnyStep", "Assert", "Base", "Call", "Callback", "Callbacks", "Conserved", "Counted", "Create", "Cycle",
    "Cycles", "Destroy", "Doing", "Drive", "DrivenGiven", "Entity", "EntityName", "EntityNames", "Expectation",
    "Fault", "FaultName", "GapGiven", "HasData", "Identifier", "Idle", "Inside", "KindName", "KindOrAny", "Labels",
    "Level", "Measure", "Measured", "Needs", "Never", "Parallel", "Periodic", "Phase", "Ping", "Profile", "Publish",
    "Qos", "Quantity", "Raise", "Reaction", "Received", "ReceivedGiven", "Register", "Released", "Repeat", "Repeated",
    "RequirementId", "Returns", "ReturnsGiven", "Scale", "Scenario", "ScenarioId", "Session", "Settle", "Spin",
    "Step", "SuiteFile", "Supports", "Take", "Takes", "Total", "Until",
]  # fmt: skip
