"""The state of a service: conditions, and health, alarms and sentences made of them; the open-loop gap."""
