"""Pictures of what was estimated or predicted."""
