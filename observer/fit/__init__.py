"""Fitting a configuration to logs: what may vary, what the logs say of it, and how sure that is."""
