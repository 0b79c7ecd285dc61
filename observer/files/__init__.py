"""Files from and for users: logs in, tables and folders of results out, whole or not at all."""
