"""Logs from other recorders: read, mapped to channels and units, joined, and checked.

A reader turns a file into sheets of raw columns (`readers`, `sheets`). `clock` finds the times of their rows,
`sources` sorts and checks these, `guess` and `mapped` assign columns to channels, and `join` makes one log of
them. Problems are collected, so that one error names all of them.
"""
