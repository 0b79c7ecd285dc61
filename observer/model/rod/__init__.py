"""The screw as a one-dimensional rod in eigenmodes."""
