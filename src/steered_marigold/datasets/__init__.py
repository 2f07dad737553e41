"""Data sets as sequences of `RgbdSample`."""
