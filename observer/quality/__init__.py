"""The state of a service: conditions, and the health, alarms and sentences derived from them; the open-loop
gap.
"""
