"""Months of machines in which something appears, or nothing does: is it reported?"""
