"""The lobes, under their short name: ``from brdfcheck.lobes import Phong``."""

from brdfcheck.brdf.lobes import *  # noqa: F403
