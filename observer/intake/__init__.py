"""Logs from other recorders: read, mapped to channels and units, joined, and checked."""
