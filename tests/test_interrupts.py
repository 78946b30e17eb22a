"""Ctrl-C at any moment of any command: exit code 2 within two seconds, one line, no traceback, nothing left behind."""

from __future__ import annotations

import contextlib
import os
import random
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import typer
from projects import SCENE, SWEEP
from selection import few
from shared import ROOT, process, shown_by, wait_for

import brdfcheck
from brdfcheck import cli
from brdfcheck.cli import ExitCode

LINE = "brdfcheck: interrupted\n"
LIMIT = 2.0

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no SIGINT to send")

# What each command is asked, and about how many seconds it takes with a full cache.
COMMANDS = {
    "help": (["--help"], 0.1),
    "list": (["list"], 0.7),
    "check": (["check", "-k", "phong"], 3.0),
    "own": (["check", "mine.py:f"], 3.0),
    "audit": (["audit"], 8.0),
    "fit": (["fit", "phong"], 3.0),
    "plot": (["plot", "albedo-vs-n", "phong", "-o", "p.svg"], 3.0),
    "sweep": (["sweep", "config.toml", "--out", "store"], 4.0),
    "render": (["render", "scene.toml", "-o", "r.png"], 4.0),
    "budget": (["budget", "scene.toml", "-o", "b.png"], 8.0),
    "study": (["study", "raw_albedo", "--size", "small", "--out", "reports"], 4.0),
    "studies": (["study", "all", "--size", "small", "--out", "reports"], 12.0),
}
MODULE = ["-m", "brdfcheck"]
# What pip writes for the console script.
SCRIPT = ["-c", "import sys\nfrom brdfcheck.__main__ import script\nsys.exit(script())"]


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Starts Python with these arguments, in a folder with something to work on, and waits until Ctrl-C is watched for."""
    (tmp_path / "scene.toml").write_text(SCENE)
    (tmp_path / "config.toml").write_text(SWEEP)
    (tmp_path / "mine.py").write_text("def f(wi, wo):\n    return 0.1 * (1 + wi[..., 2] * wo[..., 2])\n")
    started: list[subprocess.Popen[str]] = []

    def start(*arguments: str, path: str = "", watched: bool = True, **options: object) -> subprocess.Popen[str]:
        paths = {"PYTHONPATH": os.pathsep.join(filter(None, (path, str(ROOT))))}
        running = process(*arguments, environment=paths, cwd=tmp_path, stdin=subprocess.DEVNULL, **options)
        started.append(running)
        if watched:
            _wait_until_watched(running)
        return running

    yield start
    for running in started:
        running.kill()
        running.communicate()


def _wait_until_watched(running: subprocess.Popen[str]) -> None:
    """Python's own start comes before any line of the package. The thread that waits for Ctrl-C is the first one."""
    threads = Path(f"/proc/{running.pid}/task")
    if not threads.exists():
        time.sleep(0.5)
        return
    deadline = time.monotonic() + 60
    while running.poll() is None and len(list(threads.iterdir())) < 2:
        assert time.monotonic() < deadline
        time.sleep(0.001)


def interrupted(running: subprocess.Popen[str], *, twice: bool = False, whole: Callable[[], str] | None = None) -> str:
    """Sends Ctrl-C and returns what is on stderr, where the process ends as it should.

    `whole` gives what the command prints when nobody interrupts it: one that was done before the signal came has printed that.
    """
    began = time.monotonic()
    running.send_signal(signal.SIGINT)
    if twice:
        time.sleep(0.03)
        with contextlib.suppress(ProcessLookupError):
            running.send_signal(signal.SIGINT)
    output, errors = running.communicate(timeout=60)
    took = time.monotonic() - began
    if whole is not None and running.returncode in (ExitCode.PASSED, ExitCode.FAILED):
        assert without_numbers(output) == without_numbers(whole())
        return errors
    assert running.returncode == ExitCode.INTERRUPTED, errors
    assert errors.endswith(LINE)
    assert errors.count(LINE) == 1
    for word in ("Traceback", "Exception ignored", "KeyboardInterrupt", "internal error"):
        assert word not in errors
    assert took < LIMIT
    return errors


def without_numbers(text: str) -> str:
    """Seconds differ from run to run."""
    return re.sub(r"\d+", "0", text)


def nothing_half_written(folder: Path) -> None:
    left = [path.name for path in folder.rglob("*") if path.name.startswith(".")]
    assert left == []


# --- any moment ---


@pytest.mark.parametrize(
    ("how", "name", "delay", "twice"),
    [
        (MODULE, "help", 0.0, False),
        (SCRIPT, "list", 0.02, False),
        (MODULE, "list", 0.05, True),
        (SCRIPT, "check", 0.1, False),
        (MODULE, "plot", 0.2, False),
        (SCRIPT, "fit", 0.3, True),
        (MODULE, "sweep", 0.6, False),
        pytest.param(MODULE, "audit", 1.2, False, marks=pytest.mark.slow),
        (SCRIPT, "studies", 1.6, False),
    ],
    ids=lambda part: part if isinstance(part, (str, float)) else "",
)
def test_a_moment_of_a_command(start: Callable, tmp_path: Path, how: list[str], name: str, delay: float, twice: bool) -> None:
    running = start(*how, *COMMANDS[name][0])
    time.sleep(delay)
    interrupted(running, twice=twice)
    nothing_half_written(tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("turn", range(40))
def test_a_random_moment_of_a_command(start: Callable, tmp_path: Path, turn: int, monkeypatch: pytest.MonkeyPatch) -> None:
    words, seconds = list(COMMANDS.values())[turn % len(COMMANDS)]
    chance = random.Random(turn)
    if chance.random() < 0.4:  # nothing is compiled
        monkeypatch.setenv("BRDFCHECK_CACHE", str(tmp_path / "cache"))
    how = chance.choice((MODULE, SCRIPT))
    running = start(*how, *words)
    time.sleep(chance.uniform(0, 0.6 * seconds))
    if running.poll() is not None:  # a machine on which it takes no time
        assert running.returncode in (ExitCode.PASSED, ExitCode.FAILED)
        return
    interrupted(running, twice=chance.random() < 0.3, whole=lambda: start(*how, *words).communicate(timeout=120)[0])
    nothing_half_written(tmp_path)


# --- moments at which Python's own KeyboardInterrupt comes late, is dropped, or becomes something else ---

BUSY = {
    "an import that takes any exception for a missing module": """
try:
    READY
    while True:
        pass
except BaseException:
    raise ImportError("no such thing")
""",
    "a destructor": """
class Last:
    def __del__(self):
        READY
        while True:
            pass
Last()
time.sleep(60)
""",
    "native code": """
import hashlib
READY
hashlib.pbkdf2_hmac("sha256", b"", b"", 2**31 - 1)
""",
    "a handler that is not ours": """
import signal
signal.set_wakeup_fd(-1)
READY
while True:
    pass
""",
    "the pipe alone": """
import hashlib, signal
signal.signal(signal.SIGINT, lambda *_: None)
READY
hashlib.pbkdf2_hmac("sha256", b"", b"", 2**31 - 1)
""",
}


@pytest.mark.parametrize("what", few(BUSY, ("a destructor", "native code")))
@pytest.mark.parametrize("module", few(["typer", "mine"], ("mine",)))
def test_while_something_deaf_runs(start: Callable, tmp_path: Path, what: str, module: str) -> None:
    """In a module that the command line needs itself, and in a user's file."""
    ready = tmp_path / "ready"
    text = "import time\n" + BUSY[what].replace("READY", f"open({str(ready)!r}, 'w').write('.')")
    (tmp_path / "first").mkdir()
    (tmp_path / "first" / "typer.py" if module == "typer" else tmp_path / "mine.py").write_text(text)
    running = start("-m", "brdfcheck", "check", "mine.py:f", path=str(tmp_path / "first") if module == "typer" else "")
    wait_for(ready)
    assert interrupted(running) == LINE


def test_on_a_terminal_the_cursor_comes_back(tmp_path: Path) -> None:
    pty = pytest.importorskip("pty")
    (tmp_path / "slow.py").write_text(
        f"import time\ndef brdf(wi, wo):\n    open({str(tmp_path / 'ready')!r}, 'w').write('.')\n    time.sleep(60)\n"
    )
    leader, follower = pty.openpty()
    streams: dict[str, Any] = {"stdout": follower, "stderr": follower, "environment": {"TERM": "xterm-256color"}}
    with process("-m", "brdfcheck", "check", tmp_path / "slow.py", **streams) as running:
        os.close(follower)
        wait_for(tmp_path / "ready")
        time.sleep(0.3)
        running.send_signal(signal.SIGINT)
        seen = shown_by(leader)
    assert running.returncode == ExitCode.INTERRUPTED
    assert b"checking" in seen
    assert seen.endswith(b"\r\x1b[2K\x1b[?25hbrdfcheck: interrupted\r\n")


# --- what is tidied up ---

PROGRAM = """
import os, pathlib, sys, time
from brdfcheck import interruption
from brdfcheck.output import records
def ready():
    pathlib.Path("ready").write_text(".")
interruption.watch()
"""


def test_a_file_that_is_being_written_leaves_nothing(start: Callable, tmp_path: Path) -> None:
    program = "os.fsync = lambda _: (ready(), time.sleep(60))\nrecords.write_atomically('result', 'half')"
    before = set(os.listdir(tmp_path))
    running = start("-c", PROGRAM + program)
    wait_for(tmp_path / "ready")
    assert interrupted(running) == LINE
    assert set(os.listdir(tmp_path)) == before | {"ready"}


def test_tidying_has_its_time_and_no_more(start: Callable, tmp_path: Path) -> None:
    program = "with interruption.Cleanup(lambda: time.sleep(60)):\n    ready()\n    time.sleep(60)"
    running = start("-c", PROGRAM + program)
    wait_for(tmp_path / "ready")
    began = time.monotonic()
    assert interrupted(running) == LINE
    assert time.monotonic() - began > 1


def test_the_second_one_ends_it_at_once(start: Callable, tmp_path: Path) -> None:
    program = "with interruption.Cleanup(lambda: (ready(), time.sleep(60))):\n    print('.', flush=True)\n    time.sleep(60)"
    running = start("-c", PROGRAM + program)
    assert running.stdout.read(1) == "."
    running.send_signal(signal.SIGINT)
    wait_for(tmp_path / "ready")
    began = time.monotonic()
    assert interrupted(running) == LINE
    assert time.monotonic() - began < 1


def test_what_raises_while_tidying_stops_nothing(start: Callable, tmp_path: Path) -> None:
    program = """
with interruption.Cleanup(lambda: interruption.say("last")), interruption.Cleanup(lambda: 1 / 0):
    ready()
    time.sleep(60)
"""
    running = start("-c", PROGRAM + program)
    wait_for(tmp_path / "ready")
    assert interrupted(running) == "last\n" + LINE


def test_nobody_reads_the_line(start: Callable, tmp_path: Path) -> None:
    """A pipe that is full: the process ends all the same."""
    program = "os.set_blocking(2, False)\ntry:\n    while True:\n        os.write(2, b'x' * 4096)\nexcept BlockingIOError:\n"
    program += "    os.set_blocking(2, True)\nready()\ntime.sleep(60)"
    running = start("-c", PROGRAM + program)
    wait_for(tmp_path / "ready")
    began = time.monotonic()
    running.send_signal(signal.SIGINT)
    assert running.wait(60) == ExitCode.INTERRUPTED
    assert time.monotonic() - began < LIMIT


@pytest.mark.parametrize("twice", few([False, True], (False,)))
def test_no_study_is_left_nor_what_it_started(start: Callable, tmp_path: Path, twice: bool) -> None:
    studies = tmp_path / "studies"
    studies.mkdir()
    says = f"open(os.path.join({str(tmp_path)!r}, 'pid' + NAME), 'w').write(str(PID))"
    bodies = {
        "compiles": "import hashlib, os\n    {}\n    hashlib.pbkdf2_hmac('sha256', b'', b'', 2**31 - 1)",
        "stubborn": "import os, signal, time\n    signal.signal(signal.SIGINT, signal.SIG_IGN)\n"
        "    signal.set_wakeup_fd(-1)\n    {}\n    time.sleep(60)",
        "starts": "import multiprocessing, os, time\n    process = multiprocessing.get_context('spawn').Process("
        "target=time.sleep, args=(60,))\n    process.start()\n    {}\n    time.sleep(60)",
    }
    names = ["compiles", "starts"] if twice else list(bodies)
    for name in names:
        pid = "process.pid" if name == "starts" else "os.getpid()"
        body = bodies[name].format(says.replace("NAME", repr(name)).replace("PID", pid)).replace("import ", "import os, ", 1)
        text = f'"""Why?\n\nAnswer: because.\n"""\ndef run(size):\n    {body}\nplot = summary = run\n'
        (studies / f"{name}.py").write_text(text)
    program = f"""
import pathlib, sys
from brdfcheck import __main__, cores, processes, studies
studies.folder = lambda: pathlib.Path({str(studies)!r})
processes.available_cores = lambda: cores.available_cores()[:1] * {len(names)}
sys.argv = ["brdfcheck", "study", "all", "--size", "small"]
__main__.script()
"""
    running = start("-c", program)
    pids = [int(wait_for(tmp_path / f"pid{name}")) for name in names]
    assert interrupted(running, twice=twice) == LINE
    deadline = time.monotonic() + (LIMIT if twice else 0.3)  # at once: they end by themselves, a moment later
    while any(map(runs, pids)) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not any(map(runs, pids))


def runs(pid: int) -> bool:
    """Whether a process is alive; one that only waits for its parent to take notice has ended."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in ("Z", "X")
    except OSError:  # it has just gone, or this system has no such file
        return not Path("/proc/self").exists()


# --- whose handlers ---


def test_in_the_background_of_a_shell_script_nothing_is_interrupted(start: Callable) -> None:
    ignore = "import os, signal, sys\nsignal.signal(signal.SIGINT, signal.SIG_IGN)\n"
    running = start("-c", f"{ignore}os.execv(sys.executable, [sys.executable, '-m', 'brdfcheck', 'list'])", watched=False)
    time.sleep(0.4)
    running.send_signal(signal.SIGINT)
    out, err = running.communicate(timeout=60)
    assert (running.returncode, err) == (ExitCode.PASSED, "")
    assert out.startswith("lambert ")


def test_main_leaves_handlers_and_streams_alone(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)], sys.stdout, sys.stderr
    monkeypatch.setattr(sys, "argv", ["brdfcheck", "--version"])
    assert cli.main() == 0
    assert ([signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)], sys.stdout, sys.stderr) == before
    assert signal.set_wakeup_fd(-1) == -1
    assert capfd.readouterr() == (f"brdfcheck {brdfcheck.__version__}\n", "")


def test_in_a_process_of_somebody_else_it_is_an_exit_code(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """While the words are read, typer makes its own exception of KeyboardInterrupt."""

    class Command:
        def main(self, *_: object, **__: object) -> None:
            raise typer.Abort

    monkeypatch.setattr(typer.main, "get_command", lambda _: Command())
    assert cli.run(["list"]) == ExitCode.INTERRUPTED
    assert capsys.readouterr() == ("", LINE)
