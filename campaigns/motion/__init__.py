"""False and missed jumps of a nut's position, on simulated axes: `python -m campaigns.motion`."""
