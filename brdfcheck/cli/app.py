"""What every command of the command line shares: the app, exit codes, common options, and how the work starts.

A command reads its words with typer and returns a `Task`; `brdfcheck.cli.process.run` does the work outside of typer, so that
every way a command can end is decided in one place. What is expensive to import (JAX, the catalogue) is imported in the
work, once the words are known to be right.
"""

from __future__ import annotations

import contextlib
import functools
import inspect
import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated, Any, Literal

import typer

from brdfcheck import __version__
from brdfcheck.brdf.readers.base import Reading
from brdfcheck.brdf.readers.specs import is_file_spec
from brdfcheck.cli import words
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
  brdfcheck check                        the gate: your project's BRDFs, or all validated ones
  brdfcheck check phong ggx              two of them
  brdfcheck check mine.py:glossy         a BRDF of your own
  brdfcheck init                         a list of your project's BRDFs, for check
  brdfcheck audit                        what the literature claims, measured
  brdfcheck view mine.py:glossy          the same, as a page to look through
  brdfcheck certify blinn-phong-6        a proof, as a certificate to check again
  brdfcheck fit blinn-phong              the factor that normalises a lobe
  brdfcheck table ggx -o E.exr           a renderer's table, or functions for it
  brdfcheck sweep config.toml --out S    albedos over a grid, into a Zarr store
  brdfcheck plot albedo-vs-n phong       a figure for a paper
  brdfcheck render furnace -o FILE.png   a picture of a preset or of your own scene
  brdfcheck budget scene.toml            the cheapest models that a scene needs
  brdfcheck study all                    questions answered with figures, into reports/
  brdfcheck list                         names, formulas and sources

brdfcheck COMMAND --help shows the options of a command.""",
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)


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


Filter = Annotated[str, typer.Option("-k", "--filter", metavar="TEXT", help="Only the BRDFs whose names contain this text.")]
Json = Annotated[
    str | None,
    words.file(
        "--json",
        ends=(".json",),
        bare=True,
        stdout=True,
        help='Write the results as JSON; "-" writes them to standard output.',
    ),
]
Over = Annotated[
    list[words.Setting] | None,
    typer.Option(
        "--over",
        "--set",
        metavar="NAME=LO:HI",
        parser=words.setting,
        help="Let a parameter run over a range, or hold it at one value with NAME=VALUE; a vector of a shader with"
        " NAME=R,G,B. Repeatable.",
    ),
]
Hold = Annotated[
    list[words.Setting] | None,
    typer.Option(
        "--set",
        "--over",
        metavar="NAME=VALUE",
        parser=words.setting,
        help="Hold a parameter at a value; a vector of a shader with NAME=R,G,B. Repeatable.",
    ),
]
CosTheta = Annotated[
    words.Interval | None,
    typer.Option(
        "--cos-theta",
        metavar="LO:HI",
        parser=words.within(0, 1),
        help="The cosines of incidence to look at, within 0:1; 1 is normal incidence. [default: 0:1]",
    ),
]
Debug = Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")]
PLAIN = Reading()
"""How files are read where nothing is asked for: in a command it stands for the options that say more."""


def _reading(
    define: Annotated[
        list[tuple] | None,
        typer.Option(
            "-D",
            metavar="NAME[=VALUE]",
            parser=words.macro,
            help="Shader files: define a macro, whatever the file says. Repeatable.",
        ),
    ] = None,
    include: Annotated[
        list[str] | None,
        typer.Option("-I", metavar="FOLDER", help="Shader files: look for includes in this folder too. Repeatable."),
    ] = None,
    args: Annotated[
        str | None,
        typer.Option(
            "--args",
            metavar="L,V,N,X,Y",
            help="Shader files: what the arguments of the function are, in its order: L to the light, V to the viewer, N, X, Y"
            " the frame, any other word a parameter. [default: by their names]",
        ),
    ] = None,
    returns: Annotated[
        Literal["brdf", "brdf*cos"],
        typer.Option("--returns", help="Functions in files return the BRDF, or the BRDF times the cosine at the light."),
    ] = "brdf",
) -> Reading:
    return Reading(dict(define or ()), tuple(include or ()), () if args is None else tuple(args.split(",")), returns)


def command(name: str, *, epilog: str) -> Callable[[Callable[..., int]], Callable[..., int]]:
    """Makes a command of a function, which is its work: the command itself gives a `Task` of it, and has --debug besides.

    Where the function takes `how`, a `Reading`, the command has the options in its place that say how files are read.
    """

    def register(work: Callable[..., int]) -> Callable[..., int]:
        reads = inspect.signature(_reading, eval_str=True).parameters
        own = inspect.signature(work, eval_str=True).parameters

        def read(debug: Debug = False, **options: Any) -> Task:
            if "how" in own:
                options["how"] = _reading(**{key: options.pop(key) for key in reads})
            return Task(functools.partial(work, **options), debug)

        debug = inspect.signature(read, eval_str=True).parameters["debug"]
        taken = [one for key, given in own.items() for one in (reads.values() if key == "how" else (given,))]
        vars(read)["__signature__"] = inspect.Signature([*taken, debug])
        app.command(name, help=work.__doc__, epilog=epilog)(read)
        return work

    return register


@contextlib.contextmanager
def asked(place: str = "", brdf: str = "") -> Iterator[None]:
    """A ValueError within it, which says what is wrong with what was asked, becomes a UsageError that starts with `place`.

    So does whatever the code of a `brdf` in a file raises.
    """
    try:
        yield
    except UsageError:
        raise
    except ValueError as error:
        raise UsageError(f"{place}{one_line(error)}") from error
    except (Exception, SystemExit) as error:
        if not is_file_spec(brdf):
            raise
        from brdfcheck.brdf.blame import told

        raise UsageError(f"{brdf}: cannot be evaluated: {told(error)}") from error


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
