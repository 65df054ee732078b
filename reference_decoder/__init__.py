"""From a file to Gaussians: dequantising, activation, view-dependent anchors, exporters (SPEC §9). No torch.

    decode      a request answered: layers, tiles or a box, attributes
    dequantise  integers to binary32 in one stated order (SPEC §9.1, §9.2)
    explicit    Gaussians of the explicit profile (SPEC §9.3, §9.4); anchors: those of the anchor profile (SPEC §9.6)
    eyes, bake, refine   anchors to plain Gaussians: seen from where, slot by slot, together (numba)
    stream_ply  a scene to `.ply` tile by tile
    stream_gaussians  a scene's Gaussians tile by tile, for writers of other formats

Decoding to integers is `scarfmt.coding`; here integers become Gaussians. Nothing here imports `reference_encoder`.
"""
