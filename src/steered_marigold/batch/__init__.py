"""Many frames: every failure counted, none of them the end."""
