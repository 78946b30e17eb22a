"""Macros, conditions and includes: the text of a shader with all of them resolved, and where each piece of it came from.

pcpp does the work. What is added here: positions that survive macros, and limits on what a hostile file may ask for.
"""

from __future__ import annotations

import bisect
import io
import os
import re
import threading
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from pcpp.preprocessor import Action, OutputDirective, Preprocessor

from brdfcheck.brdf.readers.glsl.errors import Position, mistake
from brdfcheck.folders import readable
from brdfcheck.messages import UsageError

MOST_BYTES = 2**21
"""Bytes of a shader, with its includes."""
# Tokens that macros may expand to, expansions of macros, files included one inside the other, and directives.
_MOST_TOKENS, _MOST_EXPANSIONS, _MOST_DEPTH, _MOST_FILES = 200_000, 30_000, 24, 200
# Characters that Python takes for the end of a line and a shader does not.
_ODD_BREAKS = re.compile("[\x0b\x0c\x1c-\x1e\x85\u2028\u2029]")
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*([eE][-+]?\d+)?|\.\d+([eE][-+]?\d+)?)[fF]?$")
# pcpp's lexer keeps state in its module.
_one_at_a_time = threading.Lock()


@dataclass(frozen=True)
class Source:
    """Text to be lexed, and the place in a file of the piece that holds each character of it.

    `numbers`: macros that are numbers; `files`: all that were read, the shader itself first.
    """

    text: str
    starts: list[int]
    places: list[tuple[Position, bool]]
    numbers: Mapping[str, float]
    files: tuple[str, ...]

    def position(self, offset: int) -> Position:
        """Where a character of the text came from."""
        if not self.places:
            return Position("", 0, 0)
        index = max(bisect.bisect_right(self.starts, offset) - 1, 0)
        position, literal = self.places[index]
        return position._replace(column=position.column + offset - self.starts[index]) if literal else position


def read_text(path: str) -> str:
    """The text of a shader file. UsageError where it cannot be read."""
    whole = Position(path, 0, 0)
    with readable(path, "a shader file"), open(path, "rb") as file:
        data = file.read(MOST_BYTES + 1)
    if len(data) > MOST_BYTES:
        raise mistake(whole, f"is larger than {MOST_BYTES} bytes")
    if b"\0" in data:
        raise mistake(whole, "is not text: it holds zero bytes")
    return normalised(data.decode("utf-8-sig", "replace"))


def normalised(text: str) -> str:
    """The text with one kind of line ends, and nothing after the last visible character of a line."""
    lines = re.split(r"\r\n|\n|\r", _ODD_BREAKS.sub(" ", text))
    return "\n".join(line.rstrip() for line in lines)


def preprocess(
    text: str, path: str, *, defines: Mapping[str, str], folders: Iterable[str] = (), swept: Iterable[str] = ()
) -> Source:
    """The text of a file with its macros, conditions and includes resolved.

    `defines`: macros that hold whatever the file says; `folders`: where includes are looked for besides the file's own folder;
    `swept`: macros that are left as they are, because they are parameters. Raises ShaderError.
    """
    with _one_at_a_time:
        work = _Work(text, path, defines, folders, frozenset(swept))
        try:
            return work.run()
        except UsageError:
            raise
        except RecursionError:
            raise mistake(work.here(), "macros or includes are nested too deeply") from None
        except Exception:  # pcpp takes a directive apart without looking first
            raise mistake(work.here(), f"this #{work.directive or 'directive'} is malformed") from None


class _Work(Preprocessor):
    """pcpp with positions, limits, and one way to report a mistake."""

    def __init__(self, text: str, path: str, defines: Mapping[str, str], folders: Iterable[str], swept: frozenset[str]):
        super().__init__()
        self.directive, self._line, self._file = "", 0, os.path.abspath(path)
        self._shown = {self._file: path}
        self._texts = {self._file: text}
        self._starts: dict[str, list[int]] = {}
        self._expansions = self._files = 0
        self._bytes = len(text)
        self._kept = frozenset(defines) | swept
        self._fixed = False
        self.numbers: dict[str, float] = {}
        self.rewrite_paths = []
        for name in ("__DATE__", "__TIME__", "__PCPP__"):
            self.undef(name)
        for folder in folders:
            self.path.append(os.path.abspath(folder))
        self.define("__VERSION__ 330")
        for name, value in defines.items():
            self.define(f"{name} {value}".strip())
        self._fixed = True
        self._main = path

    def run(self) -> Source:
        """The whole file."""
        self.parse(self._texts[self._file], self._main)
        pieces: list[str] = []
        starts: list[int] = []
        places: list[tuple[Position, bool]] = []
        length, before, count = 0, None, 0
        for token in iter(self.token, None):
            if token.type in self.t_WS or token.type in self.t_COMMENT or not token.value.strip():
                before = None
                continue
            count += 1
            if count > _MOST_TOKENS:
                raise mistake(self.here(), f"macros expand to more than {_MOST_TOKENS} tokens")
            # What stands together in the file, or in a macro's text, stays together: pcpp takes numbers apart.
            macro = getattr(token, "from_macro", None)
            if before != (token.source, macro, token.lexpos):
                pieces.append("\n")
                length += 1
            literal = macro is None
            position = self._place(token, literal)
            starts.append(length)
            places.append((position, literal))
            pieces.append(token.value)
            length += len(token.value)
            before = (token.source, macro, token.lexpos + len(token.value))
        return Source("".join(pieces), starts, places, self.numbers, tuple(self._texts))

    def here(self) -> Position:
        """The directive that was looked at last."""
        return Position(self._shown.get(self._file, self._file), self._line, 1 if self._line else 0)

    def _place(self, token: Any, literal: bool) -> Position:
        file = token.source or self._file
        text = self._texts.get(file, "")
        starts = self._starts.get(file)
        if starts is None:
            starts = self._starts[file] = [0, *(found.end() for found in re.finditer("\n", text))]
        shown = self._shown.get(file, file)
        if literal:
            line = bisect.bisect_right(starts, token.lexpos)
            return Position(shown, line, token.lexpos - starts[line - 1] + 1)
        # A piece of a macro stands where the macro is used.
        line = min(max(token.lineno, 1), len(starts))
        end = starts[line] - 1 if line < len(starts) else len(text)
        names = getattr(token, "expanded_from", None) or [""]
        found = re.search(rf"\b{re.escape(names[-1])}\b", text[starts[line - 1] : end])
        return Position(shown, line, found.start() + 1 if found else 1)

    # --- what pcpp calls ---

    def define(self, tokens: Any) -> None:
        if not isinstance(tokens, str):
            name = tokens[0].value
            if name in self._kept and self._fixed:
                return
            body = "".join(token.value for token in tokens[1:]).strip()
            bare = re.sub(r"^\((.*)\)$", r"\1", body).strip()
            if len(tokens) > 1 and tokens[1].type in self.t_WS and _NUMBER.match(bare):
                self.numbers[name] = int(bare) if bare.lstrip("+-").isdigit() else float(bare.rstrip("fF"))
        super().define(tokens)
        name = (tokens.split(maxsplit=1)[0] if isinstance(tokens, str) else tokens[0].value).split("(")[0]
        for token in self.macros[name].value if name in self.macros else ():
            token.from_macro = name

    def undef(self, tokens: Any) -> None:
        if self.__dict__.get("_fixed") and not isinstance(tokens, str) and tokens[0].value in self._kept:
            return
        super().undef(tokens)

    def expand_macros(self, tokens: Any, expanding_from: Any = ()) -> Any:
        self._expansions += bool(expanding_from)
        if self._expansions > _MOST_EXPANSIONS or len(tokens) > _MOST_TOKENS:
            raise mistake(self.here(), f"macros expand to more than {_MOST_EXPANSIONS} pieces")
        return super().expand_macros(tokens, list(expanding_from))

    def on_error(self, file: Any, line: Any, msg: str) -> None:
        known = self._shown.get(str(file), self._shown[self._file])
        position = Position(known, int(line), 1) if line else self.here()
        words = msg.split()
        if line and words[0] == "Macro":
            text = self._texts.get(str(file), self._texts[self._file]).split("\n")[int(line) - 1]
            found = re.search(rf"\b{re.escape(words[1])}\b", text)
            position = position._replace(column=found.start() + 1 if found else 1)
        if msg.startswith("Could not evaluate"):
            msg = "this condition cannot be evaluated; allowed are whole numbers, defined(NAME) and operators"
        raise mistake(position, msg[:1].lower() + msg[1:] if not msg.startswith("Macro") else "macro" + msg[5:])

    def on_directive_handle(self, directive: Any, toks: Any, ifpassthru: Any, precedingtoks: Any) -> Any:
        self.directive, self._line, self._file = directive.value, directive.lineno, directive.source or self._file
        if directive.value in ("version", "extension", "line", "pragma") and not (
            directive.value == "pragma" and toks and toks[0].value == "once"
        ):
            raise OutputDirective(Action.IgnoreAndRemove)
        words = [token for token in toks if token.type not in self.t_WS]
        if directive.value == "include" and not words:
            raise mistake(self.here(), 'an include is written #include "file"')
        if directive.value == "define" and words and words[0].type != self.t_ID:
            raise mistake(self.here(), f"{words[0].value!r} is no name of a macro")
        return super().on_directive_handle(directive, toks, ifpassthru, precedingtoks)

    def on_directive_unknown(self, directive: Any, toks: Any, ifpassthru: Any, precedingtoks: Any) -> Any:
        text = "".join(token.value for token in toks)
        if directive.value == "warning":
            return True
        raise mistake(
            self.here(), f"#error {text}" if directive.value == "error" else f"there is no directive #{directive.value}"
        )

    def on_file_open(self, is_system_include: bool, includepath: str) -> Any:
        if not os.path.isfile(includepath):
            raise OSError(includepath)
        self._files += 1
        if self.include_depth > _MOST_DEPTH:
            raise mistake(self.here(), f"includes are nested more than {_MOST_DEPTH} deep: does a file include itself?")
        if self._files > _MOST_FILES:
            raise mistake(self.here(), f"more than {_MOST_FILES} files are included")
        text = read_text(includepath)
        self._bytes += len(text)
        if self._bytes > MOST_BYTES:
            raise mistake(self.here(), f"the file and its includes are larger than {MOST_BYTES} bytes")
        near = os.path.relpath(includepath)
        self._shown.setdefault(includepath, includepath if near.startswith("..") else near)
        self._texts[includepath] = text
        return io.StringIO(text)

    def on_include_not_found(self, is_malformed: bool, is_system_include: bool, curdir: str, includepath: str) -> Any:
        if is_malformed:
            raise mistake(self.here(), 'an include is written #include "file"')
        looked = [*(self.temp_path[:1] if not is_system_include else ()), *self.path]
        shown = ", ".join(os.path.relpath(folder or ".") for folder in looked)
        raise mistake(self.here(), f"cannot find {includepath!r}; looked in {shown or 'no folder'} (-I FOLDER adds one)")
