"""From a target to a verdict: the search for the largest albedo, the side checks, the report."""

from brdfcheck.names import lazy

__getattr__, __dir__ = lazy(__name__, __file__)
