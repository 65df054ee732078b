"""From a file to Gaussians: exact values, activation, view-dependent anchors (SPEC §9). No torch.

    decode       a request answered: layers, tiles or a box, attributes, as `decoded` values or a scene
    reconstruct  integers to exact values, and to Gaussians or an anchor model
    anchors      the Gaussians that anchors make for a camera (SPEC §9.6)
    bake, refine   anchors to plain Gaussians: slot by slot, then together
    region, lod_selection   the tiles in a box, and the tiles and layers of a view
    stream_gaussians  a scene's Gaussians tile by tile, for writers of other formats

Decoding to integers is `scarfmt.coding`; here integers become Gaussians. Nothing here imports `reference_encoder`.
"""
