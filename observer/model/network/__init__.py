"""Thermal networks: bodies of one temperature each, and what passes between them."""
