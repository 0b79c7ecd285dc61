"""The plant and what drives it: pure mathematics, no bus, no file, no clock."""
