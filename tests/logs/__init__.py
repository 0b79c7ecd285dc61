"""Logs made for tests, benchmarks and campaigns: machines, their plants, inputs, logs and recordings.

Everything here is made by the product's own model, or by hand. What estimates are judged by comes from
`tests/truth`, which imports nothing of the product.
"""
