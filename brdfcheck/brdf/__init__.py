"""BRDFs: lobes and their factors, the catalogue, families with parameters, and users' functions."""
