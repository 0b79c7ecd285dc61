"""The page: what the service knows, for a person at a screen, a phone or a wall."""
