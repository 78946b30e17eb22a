"""Documents that users write: TOML files, read with one set of messages."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from brdfcheck.messages import UsageError, one_line


def read_document(path: str | Path) -> tuple[dict[str, Any], str]:
    """What a TOML file says, and its name for messages. UsageError where there is none, or where it is not TOML."""
    label = one_line(path)
    try:
        if Path(path).is_dir():
            raise UsageError(f"{label} is a folder; give a TOML file")
        text = Path(path).read_bytes().decode("utf-8")
    except UsageError:
        raise
    except FileNotFoundError:
        raise UsageError(f"there is no file {label!r}") from None
    except UnicodeDecodeError:
        raise UsageError(f"{label} is not a text file in UTF-8") from None
    except (OSError, ValueError) as error:  # a ValueError: a name with a null character
        raise UsageError(f"cannot read {label!r}: {getattr(error, 'strerror', None) or one_line(error)}") from None
    try:
        return tomllib.loads(text), label
    except (ValueError, RecursionError) as error:  # also numbers of more digits than Python reads
        raise UsageError(f"{label} is not TOML: {one_line(error)}") from None
