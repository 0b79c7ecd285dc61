"""A first configuration: ready pieces for screws, modules and controls, and the questions that choose."""
