"""Recordings: written beside the loop without loss, kept within bounds, read back."""
