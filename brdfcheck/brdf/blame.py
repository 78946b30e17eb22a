"""What a user's code raised, in words: where, in which line of which file, and what most often helps."""

from __future__ import annotations

import os
import sysconfig
import traceback
from pathlib import Path

from brdfcheck.messages import one_line


class Finding(ValueError):
    """Something wrong with a user's BRDF that keeps it from being integrated. The message says what."""


INDEXING = "directions come as arrays of shape (k, 3): index the last axis, wi[..., 2] and not wi[2]"
# Code that is not the user's: this package, the standard library, and what is installed.
_FOREIGN = tuple(
    f"{Path(folder).resolve()}{os.sep}"
    for folder in (Path(__file__).parent.parent, *map(sysconfig.get_path, ("stdlib", "platstdlib", "purelib", "platlib")))
)


def told(error: BaseException) -> str:
    """``TypeError: message (mine.py:7: remedy)``: the error on one line, its place in the user's code, what helps."""
    notes = ": ".join(filter(None, (place_of(error), remedy(error))))
    text = f"{type(error).__name__}: {one_line(error)}"
    return f"{text} ({notes})" if notes else text


def place_of(error: BaseException) -> str:
    """``file:line`` of the last of the user's own lines on the way to an error; nothing where there is none."""
    lines = [(frame.f_code.co_filename, line) for frame, line in traceback.walk_tb(error.__traceback__)]
    own = [(file, line) for file, line in lines if not file.startswith(("<frozen", *_FOREIGN))]
    if not own:
        return ""
    file, line = own[-1]
    with_folder = os.path.relpath(file) if os.path.isabs(file) else file
    return f"{file if with_folder.startswith(os.pardir) else with_folder}:{line}"


def of_arrays(error: BaseException) -> bool:
    """True for what a function raises that is written for one pair of directions and gets arrays of them, or the reverse."""
    text = str(error)
    if isinstance(error, IndexError) or "ambiguous" in text or "to unpack" in text:
        return True
    shapes = ("not aligned", "mismatch", "shape", "broadcast")
    return isinstance(error, (TypeError, ValueError)) and (
        "converted to Python scalars" in text or "indices" in text or any(word in text for word in shapes)
    )


def remedy(error: BaseException) -> str:
    """What an error of a user's function most often comes from, and what helps; nothing where that is not known."""
    text = str(error)
    if "interpreted as an integer" in text:
        return "parameters are passed as floats: use int(k), or declare k: int and hold it at one value"
    if "to unpack" in text:
        return f"{INDEXING}; x, y, z = wi.T takes them apart"
    if isinstance(error, TypeError) and "converted to Python scalars" in text:
        return "functions of math take one number: use those of numpy or jax.numpy"
    if isinstance(error, IndexError) or "ambiguous" in text or ("indices" in text and isinstance(error, TypeError)):
        return f"{INDEXING}, and choose by jnp.where, not by if"
    if isinstance(error, ValueError) and ("not aligned" in text or "matmul" in text or "broadcast" in text):
        return "wi.wo of each pair is sum(wi * wo, axis=-1); give a norm axis=-1 and keepdims=True"
    if isinstance(error, ValueError) and ("math domain error" in text or text.startswith("expected a n")):
        return "rounding takes a cosine beyond 1, or what is under a root below 0: clamp it first, as in min(max(x, 0), 1)"
    if isinstance(error, ZeroDivisionError):
        return "at the horizon, or where wi + wo is 0: return 0 there, or keep the divisor above 0"
    if isinstance(error, AttributeError) and "has no attribute" in text and "ndarray" in text:
        return "a direction is an array of three numbers: its x is wi[..., 0]"
    return ""
