"""A simulated machine in its own process: `python -m drivers.simulated`.

It shares wires with the service and nothing else; its physics is its own and knows nothing of the model that
is to be tested against it.
"""
