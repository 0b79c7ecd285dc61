"""Recordings: written beside the loop without loss, kept within bounds, read back.

A recording holds every reading and tick in the order of their use. So a replay gives the published estimates
to the last bit.
"""
