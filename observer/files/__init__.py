"""Files that users give and get: logs in, tables and folders of results out, whole or not at all."""
