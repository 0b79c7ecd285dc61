"""What learning and `identify` are worth on machines that are not what their configuration says."""
