"""Procedural RGB-D frames: random rooms and streets, ray-cast with Embree.

From small to large: vectors, mesh, textures, bank, materials; models and the furniture made of them
(storage, tables, seating, fixtures, clutter, decor); shell, lamps, themes and layout, which build
a room, and streets; raycast, shading, photo, camera and render, which make frames of it; sensor,
shards and sample, which use them. `python -m rooms --help` lists the commands.
"""
