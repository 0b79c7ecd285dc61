"""Many machines: processes thousands of their logs in parallel."""
