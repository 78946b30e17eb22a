"""Microfacet BRDFs, under their short name: ``from brdfcheck.microfacet import GGX``."""

from brdfcheck.brdf.microfacet import *  # noqa: F403
