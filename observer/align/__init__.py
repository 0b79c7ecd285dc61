"""Readings to frames: each channel's latest value at every tick, plausibility, and times and units of
logs.
"""
