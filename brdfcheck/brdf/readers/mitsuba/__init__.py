"""BRDFs of Mitsuba 3: plug-ins by name, in scene files, or as a dictionary in JSON."""
