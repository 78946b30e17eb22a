"""Chromium without a window, for tests: its DevTools protocol through pipes, so that no package is needed to speak with it."""

from __future__ import annotations

import json
import os
import subprocess
import time
from pathlib import Path
from typing import Any, Self

_FLAGS = (
    "--headless", "--remote-debugging-pipe", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync", "--hide-scrollbars",
)  # fmt: skip


class Browser:
    """One page. `requests` are the addresses that it asked for, `complaints` its errors and what its console says.

    `BRDFCHECK_CHROMIUM_FLAGS`: further flags, which some builds need.
    """

    def __init__(self, program: str, profile: Path):
        self.requests: list[str] = []
        self.complaints: list[str] = []
        self._count, self._rest, self._session = 0, b"", ""
        there, self._out = os.pipe()
        self._in, back = os.pipe()
        flags = [*_FLAGS, f"--user-data-dir={profile}", *os.environ.get("BRDFCHECK_CHROMIUM_FLAGS", "").split()]

        # Chromium reads from 3 and writes to 4; a shell puts the pipes there, for a fork of this process would do more.
        shell = f'exec "$0" "$@" 3</dev/fd/{there} 4>/dev/fd/{back}'
        self._process = subprocess.Popen(
            ["/bin/sh", "-c", shell, program, *flags, "about:blank"],
            pass_fds=(there, back),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(there)
        os.close(back)

    def __enter__(self) -> Self:
        pages = [target for target in self._ask("Target.getTargets")["targetInfos"] if target["type"] == "page"]
        self._session = self._ask("Target.attachToTarget", targetId=pages[0]["targetId"], flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Network", "Log"):
            self._ask(f"{domain}.enable")
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.wait()
        os.close(self._out)
        os.close(self._in)

    def open(self, address: str) -> None:
        """Go there, and wait until the page has been loaded and drawn."""
        self._ask("Page.navigate", url=address)
        end = time.monotonic() + 30
        while not self.run("document.readyState === 'complete' && document.body.classList.contains('ready')"):
            assert time.monotonic() < end, "the page does not load"
            time.sleep(0.05)
        self.run("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")

    def run(self, code: str) -> Any:
        """The value of an expression in the page, that of a promise once it is kept."""
        answer = self._ask("Runtime.evaluate", expression=code, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def _ask(self, method: str, **parameters: Any) -> dict[str, Any]:
        self._count += 1
        message = {"id": self._count, "method": method, "params": parameters}
        message |= {"sessionId": self._session} if self._session else {}
        os.write(self._out, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._read()
            if answer.get("id") == self._count:
                assert "error" not in answer, answer
                return answer["result"]
            self._note(answer.get("method"), answer.get("params", {}))

    def _read(self) -> dict[str, Any]:
        while b"\0" not in self._rest:
            part = os.read(self._in, 1 << 20)
            assert part, "the browser has ended"
            self._rest += part
        message, _, self._rest = self._rest.partition(b"\0")
        return json.loads(message)

    def _note(self, event: str | None, what: dict[str, Any]) -> None:
        if event == "Network.requestWillBeSent":
            self.requests.append(what["request"]["url"])
        elif event == "Runtime.exceptionThrown":
            self.complaints.append(str(what["exceptionDetails"]))
        elif event == "Log.entryAdded":
            self.complaints.append(what["entry"]["text"])
        elif event == "Runtime.consoleAPICalled":
            self.complaints.append(str(what["args"]))
