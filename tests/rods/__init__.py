"""Heated rods, as anybody has them in a laboratory: no screw, no nut, one log of an hour at most."""
