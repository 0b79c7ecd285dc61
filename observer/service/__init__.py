"""The daemon: drivers, the loop, and the observers of each step. `daemon` puts them together."""
