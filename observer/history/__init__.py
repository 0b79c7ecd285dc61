"""The heats of a whole log at once, by three methods."""
