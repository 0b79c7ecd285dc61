"""Ballscrew Observer: a ball screw's temperature field, heat inputs and thermal error, in real time."""
