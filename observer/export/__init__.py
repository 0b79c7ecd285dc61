"""Code and data for a controller, written from a configuration."""
