"""Fitting a configuration to logs: free parameters, their values, and the uncertainty."""
