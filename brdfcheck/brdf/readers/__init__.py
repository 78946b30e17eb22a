"""BRDFs from the files in which people have them, a file for each format."""
