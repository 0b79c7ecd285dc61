"""Page, metrics, MQTT and OPC UA: a process that is a client of the bus, and cannot delay a tick."""
