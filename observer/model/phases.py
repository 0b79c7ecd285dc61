"""What a machine is doing, in words: the names of phases, and where one ends and the next begins."""

from __future__ import annotations

PHASES = ("isothermal", "heat_up", "steady", "dwell", "cool_down")
DWELL_S = 1500.0
"""A standstill this short, with work after it, is a dwell."""
FAST = 0.15
"""Part of a run's fastest warming that still counts as heating up."""
