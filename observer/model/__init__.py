"""The plant and its inputs: pure mathematics without bus, file or clock."""
