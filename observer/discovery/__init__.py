"""From logs to a better configuration: the search for a missing effect, its proof, and the verdict."""
