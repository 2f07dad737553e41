"""What a checkpoint is worth, by the released pipeline: `python -m training evaluate`."""
