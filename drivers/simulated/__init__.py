"""A simulated machine in its own process: `python -m drivers.simulated`.

It shares only wires with the service; its physics is its own, independent of the model that
is tested against it.
"""
