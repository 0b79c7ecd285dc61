"""What comes: the next hour, where it settles, and when."""
