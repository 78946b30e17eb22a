"""Measured BRDFs from the files of the two public databases: `merl` (.binary) and `rgl` (.bsdf, a `tensor_file`)."""
