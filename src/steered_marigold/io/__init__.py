"""Files: one format family a module, read and write."""
