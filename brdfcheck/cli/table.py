"""``brdfcheck table``: what a renderer looks up, or computes by a small function, with error bars and provenance."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from brdfcheck.brdf.readers.base import Reading
from brdfcheck.cli import words
from brdfcheck.cli.app import PLAIN, CosTheta, ExitCode, Json, Over, asked, command, start
from brdfcheck.cli.output import Output, refused
from brdfcheck.messages import UsageError, one_line

_TABLES = ("csv", "npy", "exr", "dds", "hpp")
_SOURCE = ("glsl", "hlsl", "h")
_ENDS = tuple(f".{kind}" for kind in (*_TABLES, *_SOURCE))
_BESIDE = ("npy", "dds")


@command(
    "table",
    epilog="""\b
Examples:
  brdfcheck table ggx --over roughness=0:1 -o E.exr
  brdfcheck table ggx --over roughness=0:1 --size 64x64 -o dfg.dds -o dfg.glsl
  brdfcheck table mine.py:glossy --over n=1:1000 -o table.csv
  brdfcheck table ggx --over roughness=0:1 --compensation -o E.hpp
  brdfcheck table disney.brdf --over roughness=0.1:1 --size 16x16 -o E.npy

\b
Quantities:
  E              directional albedo over the parameter and cos theta
  average        2 int E(mu) mu dmu
  scale, bias    split sum: the albedo with Schlick's Fresnel term is
                 F0 scale + bias; of facets of this package, and of
                 BRDFs with a parameter F0
  compensation   E and average of the multiple scattering of Kulla and
                 Conty, raised so that linear look-ups conserve energy

\b
Files, by their endings; rows run over the parameter, columns over cos theta:
  exr            float32 channels by name, error bars among them
  npy, csv       float64, error bars among them; npy with FILE.json beside it
  dds            two channels, R32G32 float, with FILE.json beside it
  hpp            C++ arrays with a linear look-up
  glsl, hlsl, h  small functions, with their largest error

The roughness of a BRDF that has an alpha or m instead is its square root.

\b
Exit codes:
  0  written                                 2  interrupted
  1  --check does not say CONSERVES          3  internal error
     (if it says VIOLATES nothing is         4  usage error; or there is
     written), or the BRDF cannot be            nothing to compensate, for
     evaluated                                  the albedo exceeds 1""",
)
def _table(
    name: Annotated[
        str,
        typer.Argument(
            metavar="TARGET", help="What check takes: a catalogue name, file.py:object, or a file.", show_default=False
        ),
    ],
    output: Annotated[
        list[str],
        words.file("-o", "--output", ends=_ENDS, help="Write a file; its ending says what. Repeatable."),
    ],
    over: Over = None,
    size: Annotated[
        words.Size | None,
        typer.Option(
            "--size",
            metavar="ROWSxCOLUMNS",
            parser=words.size,
            help="Nodes of the parameter and of cos theta. [default: 64x64]",
        ),
    ] = None,
    nodes: Annotated[
        Literal["centres", "ends"],
        typer.Option(help="Where nodes lie: in the centres of texels, (k+1/2)/N of the range, or from end to end, k/(N-1)."),
    ] = "centres",
    texture: Annotated[
        Literal["dfg", "albedo", "compensation"] | None,
        typer.Option(help="The two channels of a DDS file. [default: dfg, or albedo where there is no split sum]"),
    ] = None,
    compensation: Annotated[
        bool, typer.Option("--compensation", help="Also the table of the multiple-scattering compensation of Kulla and Conty.")
    ] = False,
    verify: Annotated[
        bool,
        typer.Option("--check", help="Search the BRDF with its compensation, as it is written, for an albedo above 1 + 1e-5."),
    ] = False,
    cos_theta: CosTheta = None,
    rtol: Annotated[
        float | None,
        typer.Option(metavar="NUMBER", min=1e-12, max=0.1, help="Accuracy of the cells. [default: best; functions 1e-6]"),
    ] = None,
    how: Reading = PLAIN,
    json: Json = None,
) -> int:
    """Tables for renderers: albedos, split sum, compensation.

    Each cell is integrated, with an error bar; nothing is clamped.
    """
    if verify and not compensation:
        raise UsageError("--check: it is the compensated BRDF that is checked; give --compensation too")
    if texture is not None and "dds" not in map(_kind, output):
        raise UsageError("--texture: it is a DDS file that holds two channels; give -o FILE.dds too")
    seen: dict[str, str | None] = {"--json": json}
    for number, path in enumerate(output):
        seen[f"-o ({number + 1})"] = path
        if _kind(path) in _BESIDE:
            seen[f"-o ({number + 1}), its metadata"] = f"{path}.json"
            if trouble := words.trouble_with(f"{path}.json"):
                raise UsageError(f"-o: {trouble}")
    words.refuse_same(seen)
    rows, columns = size or words.Size(64, 64)
    settings = {
        "name": name,
        "over": words.together(over),
        "size": [rows, columns],
        "nodes": nodes,
        "compensation": compensation,
        "texture": texture,
        "cos_theta": cos_theta,
        "rtol": rtol,
        "precision": "float64",
        **how.record,
    }
    return _run(settings, how, output, verify, Output(json))


def _kind(path: str) -> str:
    return Path(path).suffix.lower().removeprefix(".")


def _run(settings: Mapping[str, Any], how: Reading, paths: list[str], verify: bool, output: Output) -> int:
    start()
    from brdfcheck.brdf.blame import Finding
    from brdfcheck.fits.compact import compact_fits
    from brdfcheck.fits.compensated import checked
    from brdfcheck.fits.compensation import compensation
    from brdfcheck.fits.renderer import renderer_table
    from brdfcheck.output import records
    from brdfcheck.output.renderer_files import renderer_metadata, texture_of, write_renderer_table
    from brdfcheck.output.source import read_back, source_text
    from brdfcheck.verdict import words as verdict_words

    kinds = [_kind(path) for path in paths]
    rows, columns = settings["size"]
    added, fits, reports, facts = None, None, {}, []
    with output.progress(f"integrating {rows} x {columns} cells") as progress, asked():
        try:
            table = renderer_table(
                settings["name"],
                settings["over"],
                size=(rows, columns),
                placement=settings["nodes"],
                cos_theta=settings["cos_theta"],
                rtol=settings["rtol"],
                reading=how,
                say=lambda done, of: progress.say(f"integrating: {done} of {of} rows"),
            )
            start()  # a user's file may have changed the precision
            if settings["texture"] == "dfg" and table.scale is None:
                raise UsageError(f"--texture dfg: {table.why}")
            if settings["compensation"]:
                progress.say("integrating between the cells")
                added = compensation(table, settings["rtol"])
            if "dds" in kinds:
                texture_of(table, added, settings["texture"])
            if set(kinds) & set(_SOURCE):
                progress.say("fitting")
                fits = compact_fits(table, compensation=added)
            if verify and added is not None:
                progress.say("checking the compensated BRDF")
                if set(kinds) & set(_TABLES):
                    reports["look-ups"] = checked(added.family, added)
                if fits is not None:
                    name = table.sources.family.name
                    written = read_back(source_text("glsl", fits, name), name, table.grid.parameter)
                    reports["functions"] = checked(added.family, written)
        except Finding as finding:
            output.line(f"{settings['name']}  cannot be evaluated: {one_line(finding)}")
            return ExitCode.FAILED
    metadata = renderer_metadata(table, added, None if fits is None else fits.compensation, reports, command=output.command)
    verdicts = {report.verdict.name for report in reports.values()}
    refuted = "VIOLATES" in verdicts
    for path, kind in zip(paths, kinds, strict=True) if not refuted else ():
        if kind in _SOURCE and fits is not None:
            facts = [f"{metadata['name']}: {metadata['formula'] or 'no formula known'}", f"Parameter: {metadata['parameter']}."]
            if "functions" in reports:
                facts.append(f"Checked: {verdict_words.message(reports['functions'])}.")
            with asked():
                text = source_text(kind, fits, table.sources.family.name, facts=facts, command=output.command)
            output.save(path, text, "-o")
        else:
            with refused("-o", path), asked():
                write_renderer_table(path, table, kind, added, texture=settings["texture"], metadata=metadata)
    for text in _lines(table, added, fits, reports):
        output.line(text)
    for path in paths:
        output.line(f"  {'not written' if refuted else 'wrote':<12} {path}")
    code = ExitCode.PASSED if verdicts <= {"CONSERVES"} else ExitCode.FAILED
    summary = {"seconds": output.seconds, "exit_code": int(code)}
    found = {name: records.to_json_object(report) for name, report in reports.items()}
    result = {**metadata, "files": [] if refuted else paths, "check": found or None}
    output.write_json(lambda: records.document("table", [result], settings=settings, summary=summary))
    return code


def _lines(table: Any, added: Any, fits: Any, reports: Mapping[str, Any]) -> list[str]:
    """What was made, for a person."""
    from brdfcheck.verdict.words import albedo_text, exact, place_text

    grid = table.grid
    rows, columns = grid.values.shape
    low, high = table.bounds
    axis = f"{grid.parameter}={low:g}:{high:g}" if high > low else "one row, the BRDF has no parameter that runs"
    mapping = f" ({table.sources.mapping})" if table.sources.mapping else ""
    lines = [f"{grid.family.name}  {rows} x {columns} cells, {axis}{mapping}, {table.placement} ({grid.engine})"]
    for name, (value, bar) in table.channels.items():
        lines.append(f"  {name:<12} {value.min():.6f} to {value.max():.6f}, error bar at most {bar.max():.2g}")
    if table.why:
        lines.append(f"  no split sum: {table.why}")
    lines += [f"  note         {note}" for note in grid.family.notes]
    if fits is not None:
        split = "" if fits.share is None else f", split sum within {fits.split_sum_error:.2g}"
        average = "" if fits.average is None else f", average within {fits.average.max_error:.2g}"
        lines.append(f"  functions    albedo within {fits.albedo.max_error:.2g}{average}{split}")
    if added is not None:
        lines.append(
            f"  compensation loses at most {added.loss:.2g} with linear look-ups"
            f" (the table of E itself would exceed 1 by {max(added.excess, 0):.2g})"
        )
        if fits is not None:
            lines.append(f"  compensation loses at most {fits.compensation.loss:.2g} by the functions")
        (begins, _), *_ = added.family.ranges.values()
        if begins > low:
            lines.append(f"  note         the compensation is for {grid.parameter} from {begins:g} on")
    for name, report in reports.items():
        at = place_text(report)
        lines.append(
            f"  check        {name}: {report.verdict.name}, largest albedo {albedo_text(report)}"
            f" at {at}, tolerance {exact(report.tolerance)}"
        )
    return lines
