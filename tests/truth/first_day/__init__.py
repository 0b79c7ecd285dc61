"""Machines as most users have them: sensors on housings and nut bracket, stop-and-go work."""
