"""Frames to estimates: the one path of the live service and of a replay, and its state on disk."""
