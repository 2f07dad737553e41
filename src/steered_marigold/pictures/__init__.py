"""Colours and panels: one look for commands, evaluation, page and viewers. Figures, no files."""
