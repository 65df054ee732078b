"""Scenes of one file or many (SPEC §17), read as one: by region, by layers, or as a view needs them.

making      what an index says of a file, and an index of several
scene_set   a scene opened: counts, boxes, tiles in some order, all of it
levels      a file whose tiles are decoded after different numbers of layers
needs       which layers of which tiles a view needs, over all files
scene_ply   a scene to `.ply`, a tile at a time
stream_scene its Gaussians, a tile at a time, for any writer
checking    whether an index and its files keep the rules
"""
