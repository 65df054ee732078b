"""The container of a file: header, directory, blocks as opaque bytes (SPEC §5).

    source      where bytes come from: a file, memory, a URL, by ranges
    schema      every fixed record, declared with `construct`; the tables of SPEC §5 are made from it
    header      signature, version, header, layer summaries, with their checks in SPEC's order
    root, pages the directory, packed: where blocks, pages and tiles are
    directory   its tiles and entries as objects
    paged       an opened file: what is asked for is read, the directory page by page
    file        a whole container, written
    substreams  the table at the front of a TILE block
    morton      the order of tiles, and of anchors in them (SPEC §6.3)
    bytefields  varints and counts of block contents

Nothing here knows what a block holds. Imports nothing but `scarfmt.errors` and `scarfmt.limits`.
"""
