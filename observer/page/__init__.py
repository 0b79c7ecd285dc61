"""The page: the service's state for a person at a screen, a phone or a wall display."""
