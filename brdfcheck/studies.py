"""Studies: one question each, answered by a run, a figure and a page of numbers, kept in a folder of reports.

A study is a file with a docstring (question, command, answer) and three functions: ``run(size)`` gives what was measured
(`settings`, `results`, `summary`: plain numbers; `packages`: names of others that took part, for their versions),
``plot(record)`` the figure and ``summary(record)`` the page. This module finds the studies, runs them and writes
``record.json``, ``figure.png``, ``figure.svg``, ``summary.md``, and the gallery. A fourth function, ``pictures(record)``, may
give more files that the page shows: their bytes by name. ``ALONE = True`` says that a study wants the machine for itself,
because it times programs that use all cores; `run_all` runs the others side by side. ``GIVEN = "a folder of ..."`` says that it
takes files and folders of its user, and what they are: ``run(size, given)``.
"""

from __future__ import annotations

import ast
import importlib.util
import json
import re
import sys
import time
from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

from brdfcheck import plots, processes
from brdfcheck.cores import available_cores
from brdfcheck.messages import one_line
from brdfcheck.output import records
from brdfcheck.processes import Finished

SIZES = ("small", "full")
WIDEST = 1200
"""Pixels across a picture of a report."""
FILES = ("record.json", "figure.png", "figure.svg", "summary.md")
_GALLERY = "README.md"


@dataclass(frozen=True)
class Study:
    """A study's file, and what it says of itself: question, answer, whether it runs alone, what it may be given."""

    name: str
    path: Path
    question: str
    answer: str
    alone: bool = False
    given: str = ""


def folder() -> Path | None:
    """Where the studies are: beside the package in a checkout, inside it where it was installed. None: left out."""
    package = Path(__file__).resolve().parent
    installed, checkout = package / "_studies", package.parent / "studies"
    if installed.is_dir():
        return installed
    # Beside an installed package there may be anything of the name studies.
    return checkout if checkout.is_dir() and (package.parent / "pyproject.toml").is_file() else None


def find() -> dict[str, Study]:
    """All studies by name, in the order of the alphabet. Nothing is imported."""
    place = folder()
    paths = sorted(place.glob("*.py")) if place is not None else []
    found = [_described(path) for path in paths if not path.stem.startswith("_")]
    return {study.name: study for study in found if study is not None}


def _described(path: Path) -> Study | None:
    """What a study says of itself; None for a tool that stands alone, with none of a study's functions."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    if not any(isinstance(line, ast.FunctionDef) and line.name in ("run", "plot", "summary") for line in tree.body):
        return None
    text = ast.get_docstring(tree) or ""
    question, _, rest = text.partition("\n\n")
    answer = re.search(r"^Answer: (.*?)(?:\n\n|\Z)", rest, re.DOTALL | re.MULTILINE)
    lines = (line for line in tree.body if isinstance(line, ast.Assign))
    said = {ast.unparse(line.targets[0]): line.value for line in lines}
    facts = {name: ast.literal_eval(said[name]) for name in ("ALONE", "GIVEN") if name in said}
    answered = one_line(answer.group(1)) if answer else ""
    return Study(path.stem, path, one_line(question), answered, facts.get("ALONE", False), facts.get("GIVEN", ""))


def load(study: Study) -> ModuleType:
    """The study's module. ValueError where it lacks one of its three functions."""
    name = f"_brdfcheck_study_{study.name}"
    place = str(study.path.parent)
    if place not in sys.path:  # for its instruments, as if its file were run
        sys.path.append(place)
    spec = importlib.util.spec_from_file_location(name, study.path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    missing = [function for function in ("run", "plot", "summary") if not callable(getattr(module, function, None))]
    if missing:
        raise ValueError(f"the study {study.name} has no function {missing[0]}")
    return module


def record_of(study: Study, size: str, given: Sequence[str | Path] = ()) -> dict[str, Any]:
    """Run a study, on what it is given, and return its record, as it is written.

    ValueError for an unknown size, and for files given to a study that takes none.
    """
    if size not in SIZES:
        raise ValueError(f"size must be one of {', '.join(SIZES)}; got {size!r}")
    if given and not study.given:
        raise ValueError(f"the study {study.name} takes no files")
    began = time.perf_counter()
    measured = load(study).run(size, *([given] if given else []))
    seconds = round(time.perf_counter() - began, 2)
    record = records.document(
        f"study {study.name}",
        measured["results"],
        settings={"size": size, **measured.get("settings", {}), "precision": "float64"},
        summary={**measured.get("summary", {}), "seconds": seconds, "cores": len(available_cores())},
        packages=measured.get("packages", ()),
    )
    return {**record, "study": study.name, "question": study.question, "answer": study.answer}


def write_report(study: Study, record: Mapping[str, Any], reports: Path) -> Path:
    """Write the four files of a study's report, and its pictures, from its record alone. OSError where that fails."""
    module = load(study)
    place = reports / study.name
    place.mkdir(parents=True, exist_ok=True)
    text = to_json(record)
    record = json.loads(text)  # what is drawn is what is written
    figure = module.plot(record)
    records.write_atomically(place / "record.json", text)
    pictures = module.pictures(record) if hasattr(module, "pictures") else {}
    pictures["figure.png"] = plots.to_bytes(figure, ".png", widest=WIDEST)
    for name, content in pictures.items():
        content = plots.with_few_colours(content, WIDEST) if name.endswith(".png") else content
        records.write_atomically(place / name, content)
    records.write_atomically(place / "figure.svg", plots.to_bytes(figure, ".svg", widest=WIDEST))
    page = f"# {study.question}\n\n![{study.question}](figure.png)\n\n{module.summary(record).strip()}\n\n{_made(record)}"
    records.write_atomically(place / "summary.md", page)
    return place


def _made(record: Mapping[str, Any]) -> str:
    size = record["settings"]["size"]
    option = "" if size == "full" else f" --size {size}"
    versions = ", ".join(f"{name} {version}" for name, version in record["versions"].items())
    return (
        f"Made by `brdfcheck study {record['study']}{option}` ({versions}). The numbers behind the figure are in"
        " [record.json](record.json), the figure for print in [figure.svg](figure.svg).\n"
    )


def write_gallery(reports: Path) -> Path:
    """The page that shows every report in the folder, in the order of the alphabet: the same text for the same reports."""
    parts, minutes = [], 0.0
    for path in sorted(reports.glob("*/record.json")):
        try:
            record = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            continue
        if not isinstance(record, dict) or "study" not in record:
            continue
        name = path.parent.name
        minutes += _core_seconds(record) / 60
        small = "" if record["settings"].get("size") == "full" else " (small size)"
        answer = record["answer"]
        parts += ["", f"## {record['question']}{small}", "", answer[:1].upper() + answer[1:], ""]
        parts += [f"[![{record['question']}]({name}/figure.png)]({name}/summary.md)", ""]
        links = [f"[{label}]({name}/{file})" for label, file in (("numbers", "summary.md"), ("record", "record.json"))]
        parts.append(f"`brdfcheck study {name}` · {' · '.join(links)} · [SVG]({name}/figure.svg)")
    page = reports / _GALLERY
    head = (
        "# Reports\n\nMade by `brdfcheck study all`; this page too. Each figure is made of the numbers in its record. The runs"
        f" behind them took {minutes:.1f} minutes together, counted for each core that they had."
    )
    records.write_atomically(page, "\n".join([head, *parts]) + "\n")
    return page


def to_json(record: Mapping[str, Any]) -> str:
    """Strict JSON in which a list or mapping that holds no other is one line: a record is for reading too."""

    def flat(match: re.Match[str]) -> str:
        return re.sub(r"(,?)\n *", lambda gap: ", " if gap[1] else "", match[0])

    return re.sub(r"[\[{][^\[\]{}]*[\]}]", flat, records.to_json(record))


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)


def run_all(chosen: Sequence[Study], size: str, reports: Path) -> Generator[Finished, None, None]:
    """Run each study in a process of its own and write its report; give how each ended as soon as it has.

    Those that want the machine for themselves come one after the other, then the others side by side, a core for each, the
    longest first as far as a report in the repository tells.
    """
    # With this process's places to import from: what lies about in the current folder is none of them.
    program = f"""import sys
sys.path[:] = {sys.path!r}
from brdfcheck import interruption
interruption.watch()
from brdfcheck.studies import make
make(*sys.argv[1:])"""
    commands = {study.name: (sys.executable, "-c", program, str(study.path), size, str(reports)) for study in chosen}
    alone = [study.name for study in chosen if study.alone]
    others = sorted((study for study in chosen if not study.alone), key=_work, reverse=True)
    yield from processes.run_all({name: commands[name] for name in alone}, side_by_side=False)
    yield from processes.run_all({study.name: commands[study.name] for study in others}, side_by_side=True)


def _core_seconds(record: Mapping[str, Any]) -> float:
    """What a study took for its report, counted for each core that it had; 0 where that is not known."""
    return float(record["summary"].get("seconds", 0) * record["summary"].get("cores", 1))


def _work(study: Study) -> float:
    """That of the report in the repository; 0 where there is none."""
    try:
        record = json.loads((study.path.parent.parent / "reports" / study.name / "record.json").read_text(encoding="utf-8"))
        return _core_seconds(record)
    except (OSError, ValueError, KeyError, TypeError):
        return 0.0


def make(path: str | Path, size: str, reports: str | Path) -> Path:
    """Run the study of a file in double precision and write its report, without the gallery. Returns the report's folder."""
    from brdfcheck.runtime import use_compilation_cache, use_x64

    use_x64()
    use_compilation_cache()
    study = _described(Path(path))
    assert study is not None
    return write_report(study, record_of(study, size), Path(reports))
