"""Alarms: faults that last long enough and matter enough for somebody to come and look."""
