"""What leaves for other programs: the fit of an albedo as C or GLSL, its table as CSV, NPY or EXR, with their provenance."""

from __future__ import annotations

from brdfcheck.export.snippets import c_snippet, glsl_snippet
from brdfcheck.export.table_files import KINDS, table_metadata, write_table

__all__ = ["KINDS", "c_snippet", "glsl_snippet", "table_metadata", "write_table"]
