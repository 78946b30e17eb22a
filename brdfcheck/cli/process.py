"""Running a command, and all the ways it can end."""

from __future__ import annotations

import contextlib
import io
import logging
import os
import sys
import traceback
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NoReturn

import typer

# Importing a command's module adds it to the app.
from brdfcheck.cli import budget, certify, check, fit, init, listing, plot, render, study, sweep, table, view
from brdfcheck.cli.app import ExitCode, NothingToCheck, Task, app
from brdfcheck.cli.output import discard, open_streams, results_alone, unfailing
from brdfcheck.interruption import leave
from brdfcheck.messages import SweepError, UsageError, one_line

_COMMANDS = (budget, certify, check, fit, init, listing, plot, render, study, sweep, table, view)
# As one meets them, which is how they are listed.
_ORDER = ("check", "init", "audit", "view", "certify", "fit", "table", "plot", "sweep", "render", "budget", "study", "list")
app.registered_commands.sort(key=lambda command: _ORDER.index(str(command.name)))
_STOPPED = 130  # what typer makes of KeyboardInterrupt, if not its Abort


def run(arguments: Sequence[str]) -> int:
    """The command with these arguments. Returns the exit code; raises nothing."""
    debug = os.environ.get("BRDFCHECK_DEBUG", "0") not in ("", "0")
    with open_streams():
        try:
            task = _read(arguments)
            if not isinstance(task, Task):  # --help and --version have said what they have to say
                return task
            debug = debug or task.debug
            with results_alone(arguments), _told(debug):
                return int(task.work())
        except BaseException as error:
            return _ended(error, debug)


@contextlib.contextmanager
def _told(debug: bool) -> Iterator[None]:
    """Within it, where `debug` is set, what is logged goes to standard error, with the tracebacks of users' functions."""
    log = logging.getLogger("brdfcheck")
    handler, level = logging.StreamHandler(), log.level
    if debug:
        log.addHandler(handler)
        log.setLevel(logging.DEBUG)
    try:
        yield
    finally:
        log.removeHandler(handler)
        log.setLevel(level)


def _read(arguments: Sequence[str]) -> Task | int:
    """What the words ask for, or an exit code where nothing is left to do. UsageError where they make no sense."""
    if not arguments:
        *most, last = _ORDER
        raise UsageError(f"no command given; the commands are {', '.join(most)} and {last} (see brdfcheck --help)")
    try:
        task = typer.main.get_command(app).main(list(arguments), prog_name="brdfcheck", standalone_mode=False)
    except BrokenPipeError:
        raise
    except OSError as error:  # of the words nothing is opened: help and version were being written
        raise UsageError(f"cannot write to <stdout>: {error.strerror or error}") from None
    except Exception as error:
        # What typer raises for words it does not understand; the classes moved between its releases.
        if not hasattr(error, "format_message"):
            raise
        raise UsageError(_refusal(error, f"brdfcheck {arguments[0]}" if arguments[0] in _ORDER else "brdfcheck")) from error
    if task == _STOPPED:
        raise KeyboardInterrupt
    return task if isinstance(task, Task) else int(task or 0)


def _refusal(error: Any, command: str) -> str:
    """What typer has against a word of a command, with the name of the option, the value, and what is allowed."""
    text, parameter = error.format_message(), getattr(error, "param", None)
    if parameter is not None and error.message:
        # An option by its long name, of several by the one that its command's help begins with.
        long = [option for option in parameter.opts if option.startswith("--")] or parameter.opts
        name = long[0] if parameter.param_type_name == "option" else parameter.metavar or parameter.name
        text = error.message.removeprefix("Value error, ")
        errors = getattr(error.__cause__, "errors", list)()
        if errors and errors[0]["type"] != "value_error":  # pydantic's words on a number, which do not say what it was given
            text = f"must be {_allowed(errors[0])}; got {one_line(errors[0]['input']) or 'nothing'}"
        text = f"{name}: {text}"
    return f"{one_line(text).rstrip('.')} (see {command} --help)"


def _allowed(fault: Mapping[str, Any]) -> str:
    """What a number must be, from what pydantic has against it."""
    bounds = fault.get("ctx", {})
    if "ge" in bounds:
        return f"at least {bounds['ge']:g}"
    if "le" in bounds:
        return f"at most {bounds['le']:g}"
    return "a whole number" if fault["type"].startswith("int_") else "a number"


def _ended(error: BaseException, debug: bool) -> int:
    """The exit code of a command that has ended with this, once it is said in one line."""
    code, text = ExitCode.INTERNAL_ERROR, f"internal error: {type(error).__name__}: {one_line(error)}"
    if isinstance(error, UsageError):
        code, text = ExitCode.USAGE_ERROR, str(error)
    elif isinstance(error, SweepError):
        text = str(error)
    elif isinstance(error, NothingToCheck):
        code, text = ExitCode.NOTHING_TO_CHECK, str(error)
    elif isinstance(error, (KeyboardInterrupt, typer.Abort)):
        code, text = ExitCode.INTERRUPTED, "interrupted"
    elif isinstance(error, BrokenPipeError):
        return ExitCode.PASSED
    elif isinstance(error, SystemExit):  # rich and typer leave this way when the reader of their help has gone
        return error.code if isinstance(error.code, int) else code
    elif not debug:
        text = f"{text} (--debug shows the traceback)"
    with contextlib.suppress(OSError, ValueError):
        if debug and code not in (ExitCode.INTERRUPTED, ExitCode.NOTHING_TO_CHECK):
            traceback.print_exception(error)
        print(f"brdfcheck: {text}", file=sys.stderr, flush=True)
    return code


def main() -> int:
    """`run` on the arguments of the process, with output that survives odd terminals and readers that have gone."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a name that the terminal's encoding lacks is no reason to fail
            stream.reconfigure(errors="backslashreplace")
    with contextlib.redirect_stderr(unfailing(sys.stderr)):
        code = run(sys.argv[1:])
    for stream in (sys.stdout, sys.stderr):
        if stream is None:
            continue
        try:
            stream.flush()
        except (OSError, ValueError):  # the reader has gone, or the disk is full, which has been said; or it was closed
            discard(stream)
    return code


def script() -> NoReturn:
    """`main`, and out at once: what the console script does once Ctrl-C is watched for.

    Everything is written and flushed by then. An orderly end of the interpreter would wait for evaluations that still
    run, and takes JAX 0.8 s to take its compiler down.
    """
    leave(main())
