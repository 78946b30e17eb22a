"""Quadrature rules, one file per family."""
