"""Published steps by time: written beside the readings, an hour a file.

`writer` appends them in the service, `tending` packs closed hours and makes lost steps again. `store` reads
them by time. `pages`, `series` and `bins` answer the queries of Zenoh, OPC UA and the page.
"""
