"""The gate of a project: its BRDFs, what is expected of them, and verdicts that are known already."""
