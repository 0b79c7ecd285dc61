"""The past: recordings of readings, and the published steps, an hour a file.

A recording holds every reading and tick in the order of their use. So a replay gives the published estimates
to the last bit. `recorder` writes it, `retention` keeps it within bounds.

`step_files` and `step_store` write and read published steps. `asking` has another process read them for the
service; `bins`, `pages` and `series` shape the answer.
"""
