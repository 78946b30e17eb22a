"""``brdfcheck list``: the catalogue."""

from __future__ import annotations

from brdfcheck import __version__
from brdfcheck.cli.app import ExitCode, Filter, Json, command, filtered
from brdfcheck.cli.output import Output


@command(
    "list",
    epilog="""\b
Examples:
  brdfcheck list
  brdfcheck list -k half
  brdfcheck list | grep Blinn""",
)
def _list(substring: Filter = "", json: Json = None) -> int:
    """The catalogue: names, ranges, formulas, sources."""
    from brdfcheck.brdf import catalog
    from brdfcheck.output import records
    from brdfcheck.output import text as console

    output = Output(json)
    kept = set(filtered(catalog.names(), substring))
    entries = sorted((entry for entry in catalog.entries() if entry.name in kept), key=lambda entry: not entry.validated)
    output.write_json(
        lambda: {
            "schema": "brdfcheck-catalog",
            "schema_version": records.SCHEMA_VERSION,
            "brdfcheck": __version__,
            "entries": [
                {
                    "name": entry.name,
                    "validated": entry.validated,
                    "ranges": {name: list(bounds) for name, bounds in entry.family.ranges.items()},
                    "cos_theta": list(entry.family.cos_theta),
                    "formula": entry.formula,
                    "source": entry.source,
                    "claim": entry.claim or None,
                }
                for entry in entries
            ],
        }
    )
    if json == "-":
        return ExitCode.PASSED
    if not output.is_terminal:
        width = max(len(name) for name in kept)
        for entry in entries:
            output.line(console.entry_line(entry, width))
        return ExitCode.PASSED
    titles = {True: "Validated: must conserve energy (brdfcheck check)", False: "Published claims (brdfcheck audit)"}
    for validated, title in titles.items():
        if group := [entry for entry in entries if entry.validated is validated]:
            output.console.print(title, style="bold")
            output.line()
            console.entry_table(output.console, group)
            output.line()
    return ExitCode.PASSED
