"""``nros-conformance``: parses the command line and hands over; each command is a module of this room.

Commands are imported when they are called, so that the command starts fast.
"""

from __future__ import annotations

import argparse
import importlib
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from nros_conformance import __version__
from nros_conformance.cli import native
from nros_conformance.cli.codes import RESULTS, ExitCode

PROG = "nros-conformance"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; the exit code (DESIGN 5: pytest's meanings)."""
    arguments = sys.argv[1:] if arguments is None else arguments
    options = _parser(arguments).parse_args(arguments)
    # Subjects of errors: importing them costs little, and every command may raise them.
    from nros_conformance.formats.places import FormatError
    from nros_conformance.rmw.discovery import BackendNotFound

    try:
        if "run" in options:  # a command that a backend brought
            return int(options.run(options))
        command = importlib.import_module(f"nros_conformance.cli.{options.module}")
        code: ExitCode = command.run(options)
    except (FormatError, BackendNotFound) as error:
        return _fail(str(error), ExitCode.USAGE)
    except KeyboardInterrupt:
        return _fail("interrupted", ExitCode.INTERRUPTED)
    except BrokenPipeError:
        sys.stderr.close()  # whoever read our output has seen enough
        return ExitCode.OK
    except OSError as error:
        if error.filename is None or error.strerror is None:
            return _internal()
        return _fail(f"{error.filename}: {error.strerror}; name another file or folder", ExitCode.USAGE)
    except Exception as error:
        from nros_conformance.cli.codes import user_errors

        if isinstance(error, user_errors()):
            return _fail(str(error), ExitCode.USAGE)
        return _internal()
    return int(code)


def _internal() -> int:
    import traceback

    traceback.print_exc()
    return _fail("internal error; please report it with the lines above", ExitCode.INTERNAL)


def _fail(text: str, code: ExitCode) -> int:
    print(f"{PROG}: {text}", file=sys.stderr)
    return int(code)


class _Parser(argparse.ArgumentParser):
    """One line for what is wrong, instead of thirty of usage; and 4, because 2 is an interrupted run."""

    def error(self, message: str) -> NoReturn:
        text = re.sub(r"^argument (COMMAND|what): ", "", message)
        if match := _CHOICE.fullmatch(text):
            from nros_conformance.formats.places import nearest

            what = (
                f"{match['where']}invalid choice"
                if match["where"]
                else "no command"
                if self.prog == PROG
                else "no list"
            )
            text = f"{what} {match['word']!r}; {nearest(match['word'], _names(match['known']))}"
        else:
            text += f"; see: {self.prog} --help"
        self.exit(int(ExitCode.USAGE), f"{PROG}: {text}\n")


_CHOICE = re.compile(r"(?P<where>.*?)invalid choice: '(?P<word>.*?)' \(choose from (?P<known>.*)\)")


def _names(listed: str) -> list[str]:
    return [name.strip(" '") for name in listed.split(",")]


class _OneLineEach(argparse.HelpFormatter):
    """Room for the longest name of a command: argparse forgets that commands are indented."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog)
        self._action_max_length = len("    new-backend")


def _parser(arguments: Sequence[str]) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = _Parser(
        prog=PROG,
        formatter_class=_OneLineEach,
        description="Shows what nano-ros middleware backends really do with status events, ping and reconnection.",
        epilog="Exit codes: 0 all musts hold or are known; 1 a must failed, or declaration and behaviour differ; "
        "2 interrupted; 3 internal error; 4 usage, suite or declaration error; 5 a named backend is not available, "
        "or nothing was judged; 8 more unclear scenarios than --max-unclear.",
    )
    parser.add_argument("--version", action="version", version=f"nros-conformance {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    run = _command(commands, "run", "play suites on backends, judge, and write the results")
    run.add_argument(
        "--backend", action="append", default=[], metavar="NAME",
        help="an installed backend, or module:Class; default: all that are available",
    )  # fmt: skip
    _selection(run)
    run.add_argument(
        "--max-unclear", type=_count, default=0, metavar="N",
        help="tolerate N scenarios that stay unclear after repeats (default 0)",
    )  # fmt: skip
    run.add_argument(
        "--known", type=Path, metavar="FILE", help="[[known]] entries of your own, added to those of backend.toml"
    )
    run.add_argument(
        "--option", action="append", default=[], metavar="NAME=VALUE",
        help="an option for the adapters; XRCE: agent=HOST:PORT, an agent of yours in the place of its own",
    )  # fmt: skip
    run.add_argument("--agent", metavar="HOST:PORT", help="the same as --option agent=HOST:PORT")
    run.add_argument("--junit", type=Path, metavar="FILE", help="also write the verdicts as JUnit XML")
    run.add_argument("--json", action="store_true", help="print the reports as JSON instead of text")
    native.arguments(run)
    run.add_argument("--declaration", metavar="FILE", help="what the library claims; default: derived, see declare")
    run.add_argument(
        "--wrap", default="", metavar="COMMAND", help='put before the worker process: "valgrind", "gdb --args"'
    )
    run.add_argument(
        "--debug", action="store_true", help="one scenario at a time in the terminal, no time limit; nothing is kept"
    )

    declare = _command(commands, "declare", "probe a compiled backend and draft its declaration")
    native.arguments(declare, required=True)
    declare.add_argument("--output", type=Path, metavar="FILE", help="write the draft there; default: print it")

    lister = _command(commands, "list", "list backends, suites, scenarios or requirements", module="listing")
    lister.add_argument("what", choices=["backends", "suites", "scenarios", "requirements"])
    lister.add_argument("--coverage", action="store_true", help="with requirements: which scenarios prove each")
    lister.add_argument("--json", action="store_true", help="print JSON instead of text")

    matrix = _command(commands, "matrix", "merge results into matrix.md and its web page")
    matrix.add_argument("--output", type=Path, default=Path("matrix.md"), metavar="FILE", help="default: matrix.md")
    matrix.add_argument("--html", type=Path, metavar="FILE", help="also write the web page")
    matrix.add_argument("--readme", type=Path, metavar="FILE", help="also copy the table into this README")
    matrix.add_argument(
        "--badges", type=Path, metavar="DIR", help="also write a badge for each row: SVG, and JSON for shields.io"
    )
    instead = matrix.add_mutually_exclusive_group()
    instead.add_argument(
        "--check", action="store_true", help="compare with FILE instead of writing it; exit 1 if they differ"
    )
    instead.add_argument(
        "--diff",
        type=Path,
        metavar="OLD",
        help="print instead what changed since OLD, a results directory or matrix.md",
    )

    doctor = _command(commands, "doctor", "say what this machine lacks, and which evidence that costs")
    doctor.add_argument(
        "--backend", action="append", default=[], metavar="NAME",
        help="look at this backend alone; exit 5 if it is not available",
    )  # fmt: skip

    rejudge = _command(commands, "rejudge", "judge stored traces again")
    rejudge.add_argument("directory", type=Path, nargs="?", metavar="DIR", help="default: the results directory")

    mutants = _command(commands, "mutants", "play defective backends: each has to be caught by the suites")
    mutants.add_argument("--backend", default="reference", metavar="NAME", help="whose mutants; default: reference")
    mutants.add_argument("--mutant", action="append", default=[], metavar="NAME", help="only this mutant")
    mutants.add_argument("--json", action="store_true", help="print the report as JSON instead of text")

    explore = _command(commands, "explore", "search generated timelines for departures from the model")
    explore.add_argument(
        "--backend", required=True, metavar="NAME", help="an installed backend, one of its rows, or module:Class"
    )
    explore.add_argument("--against", metavar="NAME", help="play the same on this one and report the differences")
    explore.add_argument("--examples", type=int, default=200, metavar="N", help="timelines to play; default: 200")
    explore.add_argument("--seed", type=int, default=1, metavar="S", help="the same seed, the same search; default: 1")
    explore.add_argument(
        "--output", type=Path, default=RESULTS / "explored.yaml", metavar="FILE",
        help=f"a suite of the scenarios that were found; default: {RESULTS}/explored.yaml",
    )  # fmt: skip

    explain = _command(commands, "explain", "why a scenario or cell says what it says")
    explain.add_argument(
        "subject", nargs="+", metavar="SUBJECT",
        help="[BACKEND] SCENARIO, BACKEND/COLUMN, a requirement, a note key, or a word of the legend",
    )  # fmt: skip
    explain.add_argument("--svg", type=Path, metavar="FILE", help="also draw the timeline of the scenario")

    new = _command(commands, "new-backend", "write the package of a new backend", module="new_backend")
    new.add_argument("name", metavar="NAME", help="lower case, as in: mqtt")
    new.add_argument("--into", type=Path, metavar="DIR", help="default: nros-NAME in this directory")

    if next((word for word in arguments if not word.startswith("-")), None) not in commands.choices:
        from nros_conformance.cli.extras import add_extras  # so that our own commands do not wait for them

        add_extras(commands)
    return parser


def _command(
    commands: argparse._SubParsersAction[argparse.ArgumentParser], name: str, what: str, module: str | None = None
) -> argparse.ArgumentParser:
    command = commands.add_parser(name, help=what, description=f"{what[0].upper()}{what[1:]}.")
    command.set_defaults(module=module or name)
    command.add_argument("--results", type=Path, default=RESULTS, metavar="DIR", help=f"default: {RESULTS}")
    command.add_argument(
        "--suites", type=Path, default=None, metavar="DIR", help="suite files to use instead of the built-in ones"
    )
    return command


def _count(text: str) -> int:
    """A number of things."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text!r} is not a number from 0 on")
    return int(text)


def _selection(command: argparse.ArgumentParser) -> None:
    command.add_argument("--suite", action="append", default=[], metavar="NAME", help="only scenarios of this suite")
    command.add_argument(
        "--scenario", action="append", default=[], metavar="ID", help="only this scenario; * is allowed"
    )
    command.add_argument(
        "--requirement", action="append", default=[], metavar="ID", help="only scenarios that prove this requirement"
    )
    command.add_argument(
        "--profile", choices=["smoke", "standard", "publish"], default="standard", help="default: standard"
    )


if __name__ == "__main__":
    sys.exit(main())
