"""Procedural indoor RGB-D frames: random rooms, ray-cast with Embree."""
