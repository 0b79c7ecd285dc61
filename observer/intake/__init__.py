"""Logs as others wrote them: read, mapped to channels and units, joined, and checked."""
