"""``brdfcheck init``: a first list of a project's BRDFs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from brdfcheck.cli.app import ExitCode, NothingToCheck, command, start
from brdfcheck.cli.output import Output
from brdfcheck.messages import UsageError


@command(
    "init",
    epilog="""\b
Examples:
  brdfcheck init
  brdfcheck init --dry-run

The list goes to the end of pyproject.toml where there is one, else into brdfcheck.toml.""",
)
def _init(
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Show the list, and write nothing.")] = False,
) -> int:
    """List the BRDFs of this folder for brdfcheck check.

    Finds shaders, documents and tables that can be read, and Python functions and classes that look like BRDFs, in this
    folder and those below it. Python files are not run. Parameters without a known range are left for you to say.
    """
    from brdfcheck.documents import read_text
    from brdfcheck.gate.config import OWN, SHARED, read
    from brdfcheck.gate.drafts import draft, found

    here = Path()
    shared = (here / SHARED).is_file()
    if (here / OWN).exists() or (shared and read(SHARED) is not None):
        raise UsageError(f"{OWN if (here / OWN).exists() else SHARED} lists the BRDFs of this folder already; change it there")
    start()
    subjects = list(found(here))
    named = [subject for subject in subjects if subject.target is not None]
    if not named:
        raise NothingToCheck("nothing to check: no file in this folder holds a BRDF; see docs/gate.md for how one is listed")
    output = Output(alone=dry_run)
    text, path = draft(subjects, "tool.brdfcheck." if shared else ""), SHARED if shared else OWN
    if dry_run:
        output.save("-", text, "--dry-run")
    else:
        before, own = read_text(SHARED) if shared else ("", str)
        output.save(path, own(before.rstrip("\n") + "\n\n" + text if shared else text), path)
    open_ones = sum(bool(subject.missing) for subject in named)
    said = f", {open_ones} of them commented out until you give their ranges" if open_ones else ""
    output.line(f"{'would write' if dry_run else 'wrote'} {path}: {len(named)} BRDFs{said}")
    return ExitCode.PASSED
