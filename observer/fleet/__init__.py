"""Many machines: thousands of their logs worked through side by side."""
