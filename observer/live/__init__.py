"""The daemon: drivers, the loop, and the observers of each step."""
