"""From logs to a better configuration: what may be fitted, the fit, and writing it back."""
