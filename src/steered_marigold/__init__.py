"""Dense metric depth from one image plus whatever depth a sensor managed to measure."""
