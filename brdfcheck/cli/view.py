"""``brdfcheck view``: checks BRDFs and opens the page of what was found."""

from __future__ import annotations

import webbrowser
from typing import Annotated, Any

import typer

from brdfcheck.brdf.readers.base import Reading
from brdfcheck.cli import check, words
from brdfcheck.cli.app import PLAIN, CosTheta, ExitCode, Over, command
from brdfcheck.cli.output import Output, has_display
from brdfcheck.cli.reports import address


@command(
    "view",
    epilog="""\b
Examples:
  brdfcheck view mine.py:glossy --over n=1:1000
  brdfcheck view disney.brdf -o disney.html
  brdfcheck view phong ggx --no-open

The page is one file that needs no network: keep it, send it, print it. The exit codes are
those of brdfcheck check.""",
)
def _view(
    names: Annotated[
        list[str], typer.Argument(metavar="NAME", help="What brdfcheck check takes: catalogue names, or files of your own.")
    ],
    over: Over = None,
    cos_theta: CosTheta = None,
    how: Reading = PLAIN,
    tolerance: check.Tolerance = None,
    effort: check.Effort = None,
    jobs: check.Jobs = None,
    out: Annotated[str, words.file("-o", "--output", ends=(".html", ".htm"), help="The file of the page.")] = "brdfcheck.html",
    no_open: Annotated[bool, typer.Option("--no-open", help="Write the page, but open no browser.")] = False,
) -> int:
    """Check BRDFs and look at what was found in a browser.

    Heat maps of the albedo over parameters and angles, cuts, and spheres in a white furnace, with sliders.
    """
    options: Any = {"tolerance": tolerance, "effort": effort, "jobs": jobs, "html": out}
    code = check.check_command(names=names, over=over, cos_theta=cos_theta, how=how, **options)
    # Where some of several could not be read the page shows the others.
    shown = (ExitCode.PASSED, ExitCode.FAILED, ExitCode.USAGE_ERROR)
    opened = not no_open and code in shown and has_display() and webbrowser.open(address(out))
    Output().line(f"{out}: {'opened in a browser' if opened else f'open it in a browser: {address(out)}'}")
    return code
