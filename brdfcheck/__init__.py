"""Does this BRDF conserve energy? Directional albedos with error bars, and verdicts on whole families of BRDFs.

The public names are those of the stub beside this file; they are imported when they are first used.
"""

from brdfcheck.names import lazy

__version__ = "0.1.0"
__getattr__, __dir__ = lazy(__name__, __file__)
