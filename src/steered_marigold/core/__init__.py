"""Tensors in, tensors out: no files, no diffusers, no command line, no logging."""
