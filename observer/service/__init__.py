"""The daemon: readings to frames, frames to estimates, live and replayed."""
