"""Running a command, and all the ways it can end."""

from __future__ import annotations

import contextlib
import io
import os
import sys
import traceback
from collections.abc import Sequence
from typing import Any, NoReturn

import typer

# Importing a command's module adds it to the app.
from brdfcheck.cli import budget, check, fit, listing, plot, render, study, sweep
from brdfcheck.cli.app import ExitCode, NothingToCheck, Task, app
from brdfcheck.cli.output import discard, open_streams, unfailing
from brdfcheck.interruption import leave
from brdfcheck.messages import UsageError, one_line

_COMMANDS = (budget, check, fit, listing, plot, render, study, sweep)


def run(arguments: Sequence[str]) -> int:
    """The command with these arguments. Returns the exit code; raises nothing."""
    with open_streams():
        return _run(arguments)


def _run(arguments: Sequence[str]) -> int:
    debug = os.environ.get("BRDFCHECK_DEBUG", "0") not in ("", "0")
    try:
        if not arguments:
            raise UsageError(f"no command given; the commands are {_commands()} (see brdfcheck --help)")
        try:
            command = typer.main.get_command(app)
            task = command.main(list(arguments), prog_name="brdfcheck", standalone_mode=False)
        except typer.Abort:  # what typer makes of KeyboardInterrupt
            raise KeyboardInterrupt from None
        except BrokenPipeError:
            raise
        except OSError as error:  # of the words nothing is opened: help and version were being written
            raise UsageError(f"cannot write to <stdout>: {error.strerror or error}") from None
        except Exception as error:
            # What typer raises for words it does not understand; the classes moved between its releases.
            if not hasattr(error, "format_message"):
                raise
            return _usage_error(error)
        if not isinstance(task, Task):  # --help and --version have said what they have to say
            return int(task or 0)
        debug = debug or task.debug
        return int(task.work())
    except UsageError as error:
        return _complain(str(error), ExitCode.USAGE_ERROR)
    except NothingToCheck as error:
        return _complain(str(error), ExitCode.NOTHING_TO_CHECK)
    except KeyboardInterrupt:
        return _complain("interrupted", ExitCode.INTERRUPTED)
    except BrokenPipeError:
        return ExitCode.PASSED
    except SystemExit as error:  # rich and typer leave this way when the reader of their help has gone
        return error.code if isinstance(error.code, int) else ExitCode.INTERNAL_ERROR
    except Exception as error:
        if debug:
            with contextlib.suppress(OSError, ValueError):
                traceback.print_exc()
        hint = "" if debug else " (--debug shows the traceback)"
        return _complain(f"internal error: {type(error).__name__}: {one_line(error)}{hint}", ExitCode.INTERNAL_ERROR)


def _commands() -> str:
    *most, last = (command.name or "" for command in app.registered_commands)
    return f"{', '.join(most)} and {last}"


def _usage_error(error: Any) -> int:
    context = getattr(error, "ctx", None)
    path = context.command_path if context is not None else "brdfcheck"
    text = one_line(error.format_message()).rstrip(".").replace("Value error, ", "")
    return _complain(f"{text} (see {path} --help)", ExitCode.USAGE_ERROR)


def _complain(text: str, code: ExitCode) -> int:
    with contextlib.suppress(OSError, ValueError):
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
