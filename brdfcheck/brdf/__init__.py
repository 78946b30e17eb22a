"""BRDFs: lobes and their factors, the catalogue, families with parameters, and users' functions."""

from brdfcheck.names import lazy

__getattr__, __dir__ = lazy(__name__, __file__)
