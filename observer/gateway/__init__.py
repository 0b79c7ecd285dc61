"""What people and plants look through: a process beside the service that serves the
page, metrics, MQTT and OPC UA, fed with the very messages that go to Zenoh, so that none of them can delay
a tick.
"""
