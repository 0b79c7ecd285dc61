"""The table of faults, `make faults`: what is promised, and what the real daemon did."""
