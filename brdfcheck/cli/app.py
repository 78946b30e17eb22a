"""What every command of the command line shares: the app, exit codes, common options, and how the work starts.

A command reads its words with typer and returns a `Task`; `brdfcheck.cli.process.run` does the work outside of typer, so that
every way a command can end is decided in one place. What is expensive to import (JAX, the catalogue) is imported in the
work, once the words are known to be right.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated

import typer

from brdfcheck import __version__
from brdfcheck.messages import UsageError, one_line


class ExitCode(IntEnum):
    """How a command ended; the same numbers as pytest's."""

    PASSED = 0
    FAILED = 1
    INTERRUPTED = 2
    INTERNAL_ERROR = 3
    USAGE_ERROR = 4
    NOTHING_TO_CHECK = 5


class NothingToCheck(Exception):
    """No BRDF is left to check; the message says why."""


@dataclass(frozen=True)
class Task:
    """What the words ask for: run once they have been read."""

    work: Callable[[], int]
    debug: bool


app = typer.Typer(
    name="brdfcheck",
    help="Does this BRDF conserve energy?",
    epilog="""\b
Examples:
  brdfcheck check                        the gate: every validated BRDF
  brdfcheck check phong ggx              two of them
  brdfcheck check mine.py:glossy         a BRDF of your own
  brdfcheck audit                        what the literature claims, measured
  brdfcheck fit blinn-phong              the factor that normalises a lobe
  brdfcheck sweep config.toml --out S    albedos over a grid, into a Zarr store
  brdfcheck plot albedo-vs-n phong       a figure for a paper
  brdfcheck render furnace -o FILE.png   a picture: presets, or a scene of your own
  brdfcheck budget scene.toml            the cheapest models that a scene needs
  brdfcheck study all                    questions answered with figures, into reports/
  brdfcheck list                         names, formulas and sources

brdfcheck COMMAND --help shows the options of a command.""",
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)

EXIT_CODES = """\b
Exit codes:
  0  all conserve energy            3  internal error
  1  some violate the law, are      4  usage error
     undecided, or have findings    5  nothing to check
  2  interrupted"""


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"brdfcheck {__version__}")
        raise typer.Exit()


@app.callback()
def _main(
    version: Annotated[
        bool, typer.Option("--version", help="Show the version and exit.", is_eager=True, callback=_show_version)
    ] = False,
) -> None:
    pass


Filter = Annotated[str, typer.Option("-k", "--filter", metavar="SUBSTRING", help="Only the BRDFs whose names contain this.")]
Json = Annotated[str | None, typer.Option("--json", metavar="FILE", help='Write the results as JSON; "-" is stdout.')]
Debug = Annotated[bool, typer.Option("--debug", help="Show the traceback of an internal error.")]


def refuse_outputs(outputs: Mapping[str, str | None]) -> None:
    """UsageError where one of the files {option: path} cannot be written, or two options name the same file.

    "-" and None pass: stdout, and nothing to write.
    """
    from brdfcheck.output.records import refuse_output

    seen: dict[str, str] = {}
    for option, path in outputs.items():
        if path is None or path == "-":
            continue
        trouble = refuse_output(path)
        if trouble:
            raise UsageError(f"{option}: cannot write {path!r}: {one_line(trouble)}")
        first = seen.setdefault(os.path.realpath(path), option)
        if first != option:
            raise UsageError(f"{first} and {option} name the same file: {path}")


def start() -> None:
    """Double precision and the compilation cache, before anything is computed."""
    from brdfcheck.runtime import use_compilation_cache, use_x64

    use_x64()
    use_compilation_cache()
    # What is logged is also in the notes of a report.
    logging.getLogger("brdfcheck").addHandler(logging.NullHandler())


def filtered(names: Sequence[str], substring: str) -> list[str]:
    """The names that contain the text, in either case. NothingToCheck where none does."""
    kept = [name for name in names if substring.lower() in name.lower()]
    if not kept:
        raise NothingToCheck(f"nothing to check: no name contains {substring!r}; brdfcheck list shows all names")
    return kept
