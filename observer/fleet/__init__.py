"""Many machines: thousands of their logs worked through side by side, and many axes served from one place."""
