"""Faults in the values of machines that are as rough as `[tolerance]` says: is what is called good right?"""
