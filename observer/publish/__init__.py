"""Estimates to subscribers: what a message holds, and how it goes out and comes in."""
