"""What leaves the package: records, text, curves, tables and source code, each with its provenance."""
