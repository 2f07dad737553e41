"""Frames from where they are to where their depth goes: sources, completion and record, outputs."""
