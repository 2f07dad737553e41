"""Methods on data under a protocol: runs, tables, figures."""
