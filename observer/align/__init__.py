"""Readings to frames: each channel's latest value at every tick, plausibility, times and units of logs."""
