"""From frames to estimates: the one path of live service and replay, and its state on disk."""
