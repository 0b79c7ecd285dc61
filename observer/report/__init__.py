"""Pictures and pages of estimates and predictions."""
