"""Pictures, pages and texts of results, for people.

Nothing here computes an estimate: functions take results or their JSON documents. matplotlib is imported by
the functions that draw, since it is slow to import.
"""
