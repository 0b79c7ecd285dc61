"""The campaign: hide effects in an independent machine, let the workflow search, judge what it says."""
