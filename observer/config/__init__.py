"""The configuration of a machine without its drivers: its tables and effects, every unit and range of them
checked once, here.
"""
