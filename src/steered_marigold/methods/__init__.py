"""Every way to complete depth, behind one protocol: `DepthCompleter`."""
