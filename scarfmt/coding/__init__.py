"""From blocks to the integers of a scene and back: where the codecs come together.

    reader      a file's models, then its tiles, for some layers, tiles and streams
    writer      a quantised scene to a file
    tile        the sub-streams of one tile and layer, in their order (SPEC §7.1)
    models      what belongs to no tile, from the blocks of a file
    checks_of_models, checks_of_scene   what blocks must have of one another; what a scene must be to be written
    work        how much a file asks a decoder to do, before it is done (SPEC §13.2)

Beside it, since networks count and are watched too: `scarfmt.counters`, what a decode did, and `scarfmt.observe`, what
it computed on the way, for the conformance protocol.

Decoding to integers happens here. `reference_decoder` makes Gaussians of them.
"""
