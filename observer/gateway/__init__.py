"""A process beside the service that serves the page, metrics, MQTT and OPC UA. It gets the same messages as
Zenoh, and none of its outlets can delay a tick.
"""
