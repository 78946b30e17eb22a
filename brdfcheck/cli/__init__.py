"""The command line: one file per command, `main` runs them."""

from brdfcheck.cli.app import ExitCode as ExitCode
from brdfcheck.cli.process import main as main
from brdfcheck.cli.process import run as run
from brdfcheck.cli.process import script as script
