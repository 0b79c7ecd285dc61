"""The daemon: drivers, the loop, and what follows each of its steps."""
