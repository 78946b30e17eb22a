"""``brdfcheck list``: the catalogue."""

from __future__ import annotations

from brdfcheck import __version__
from brdfcheck.cli.app import Debug, ExitCode, Filter, Json, Task, app, filtered, refuse_outputs
from brdfcheck.cli.output import Output, save


@app.command(
    "list",
    epilog="""\b
Examples:
  brdfcheck list
  brdfcheck list -k half
  brdfcheck list | grep Blinn""",
)
def _list(substring: Filter = "", json: Json = None, debug: Debug = False) -> Task:
    """The catalogue: names, ranges, formulas, sources."""
    return Task(lambda: _run_list(substring, json), debug)


def _run_list(substring: str, json: str | None) -> int:
    from brdfcheck.output import records

    refuse_outputs({"--json": json})
    from brdfcheck.brdf import catalog
    from brdfcheck.output import text as console

    output = Output(json)
    kept = set(filtered(catalog.names(), substring))
    groups = [
        [entry for entry in catalog.entries() if entry.name in kept and entry.validated is validated]
        for validated in (True, False)
    ]
    if json:
        entries = [
            {
                "name": entry.name,
                "validated": entry.validated,
                "ranges": {name: list(bounds) for name, bounds in entry.family.ranges.items()},
                "cos_theta": list(entry.family.cos_theta),
                "formula": entry.formula,
                "source": entry.source,
                "claim": entry.claim or None,
            }
            for group in groups
            for entry in group
        ]
        text = records.to_json(
            {
                "schema": "brdfcheck-catalog",
                "schema_version": records.SCHEMA_VERSION,
                "brdfcheck": __version__,
                "entries": entries,
            }
        )
        if json == "-":
            output.stdout(text)
            return ExitCode.PASSED
        save(json, text, "--json")
    if not output.is_terminal:
        width = max(len(name) for name in kept)
        for entry in (*groups[0], *groups[1]):
            output.line(console.entry_line(entry, width))
        return ExitCode.PASSED
    titles = ("Validated: must conserve energy (brdfcheck check)", "Published claims (brdfcheck audit)")
    for title, group in zip(titles, groups, strict=True):
        if group:
            output.console.print(title, style="bold")
            output.line()
            console.entry_table(output.console, group)
            output.line()
    return ExitCode.PASSED
