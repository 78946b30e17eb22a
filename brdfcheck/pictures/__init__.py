"""Pictures of scenes: the seed's figures and other presets, scene files, sheets with titles, PNG and EXR, colour."""
