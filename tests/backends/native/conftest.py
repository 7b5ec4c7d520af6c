from __future__ import annotations

import functools
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from nros_backends.native.draft import ADAPTER, draft
from nros_backends.native.options import Options
from nros_backends.native.surveyor import survey
from nros_conformance.campaign.plans import Row, make_plan
from nros_conformance.campaign.selection import Selection
from nros_conformance.judge.judge import judge
from nros_conformance.judge.results import Verdict
from nros_conformance.play.launch import PLAIN, Launch
from nros_conformance.play.pool import Ended, Pool
from nros_conformance.rmw.declaration import Declaration, load_declaration
from nros_conformance.rmw.loading import find_compiler
from nros_conformance.suite.loader import load_suites
from nros_conformance.trace.files import read_trace
from tests.backends.native.compiling import EXAMPLE, FLAGS, LIBRARIES, Build

_suites = functools.cache(load_suites)


@pytest.fixture(scope="session")
def build(tmp_path_factory: pytest.TempPathFactory) -> Build:
    """Compiles a source of the example or of these tests, once each."""
    compiler = find_compiler()
    if not compiler:
        pytest.skip("there is no C compiler")
    folder = tmp_path_factory.mktemp("libraries")

    @functools.cache
    def compiled(source: str, defect: str = "NONE", name: str = "", flags: tuple[str, ...] = ()) -> Path:
        file = EXAMPLE / source if (EXAMPLE / source).is_file() else LIBRARIES / source
        library = folder / f"lib{name or f'{file.stem}_{defect.lower()}'}.so"
        subprocess.run(
            [compiler, *FLAGS, f"-DDEFECT={defect}", *flags, str(file), "-o", str(library)],
            check=True, capture_output=True,
        )  # fmt: skip
        return library

    return compiled


@pytest.fixture(scope="session")
def loopback(build: Build) -> Path:
    return build("loopback.c", name="loopback")


@pytest.fixture(scope="session")
def declared(loopback: Path) -> Declaration:
    answers, crashes = survey(Options(str(loopback)))
    assert crashes == ()
    return load_declaration(Path("loopback.toml"), draft(answers, loopback.name))


@pytest.fixture
def play(declared: Declaration, tmp_path: Path) -> Callable[..., dict[str, Verdict]]:
    """Plays scenarios on a library in a worker process, and judges."""

    def played(
        library: Path, *scenarios: str, storage: str = "fresh", name: str = "loopback", launch: Launch = PLAIN
    ) -> dict[str, Verdict]:
        suites = _suites()
        options = Options(str(library), name=name, storage=storage, supports=frozenset(range(5)))
        row = Row(declared, ADAPTER, options=options.texts())
        plans = [make_plan(one, row, suites, tmp_path) for one in Selection(scenarios=scenarios).choose(suites)]
        ended: list[Ended] = []
        pool = Pool(
            tmp_path / "worker.log", virtual=False, ended=ended.append, casualty=lambda _: None, launch=launch
        )  # fmt: skip
        pool.play(plans, 4)
        return {one.plan.key: judge(read_trace(Path(one.plan.trace))) for one in ended}

    return played
