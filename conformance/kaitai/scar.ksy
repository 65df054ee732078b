# The container of a .scar file for Kaitai Struct: header, ROOT, pages, blocks, and within blocks the parts that are plain
# fields. SPEC.md is the authority; section numbers are its. Not expressed here: checksums, the rules between fields that
# R-5.3 to R-5.5 state, entropy coding, Zstandard frames and Rice codes.
#
# Compile with kaitai-struct-compiler 0.11:  kaitai-struct-compiler -t python scar.ksy
meta:
  id: scar
  title: Progressive neural-compressed scene of 3D Gaussians (.scar 0.2)
  file-extension: scar
  license: CC0-1.0
  ks-version: 0.11
  endian: le
doc: |
  A scene of 3D Gaussians in layers. Header, ROOT and pages say where every block lies; blocks are in the order in which
  a reader wants them, layer by layer, so a file cut after a layer is that scene, coarser.
doc-ref: SPEC.md
seq:
  - id: header
    type: file_header
  - id: layers
    type: layer_summary(_index)
    repeat: expr
    repeat-expr: header.layer_count
  - id: header_crc32
    type: u4
    doc: CRC-32 of every byte before this field (R-5.2-4)
  - id: root
    type: root
    size: header.root_length
  - id: tile_pages
    type: tile_page(_index)
    size: root.pages[_index].tile_bytes.value
    repeat: expr
    repeat-expr: page_count
  - id: row_pages
    type: layer_pages(_index)
    repeat: expr
    repeat-expr: header.layer_count
    doc: The row pages of every layer
instances:
  page_size:
    value: 1 << header.page_bits
    doc: Tiles of a page; the last may have fewer
  page_count:
    value: (header.tile_count + page_size - 1) / page_size
  first_layer_block:
    value: layers[0].blocks.models[0].body.as<layer_block>
    doc: The LAYER block of layer 1, the first of every conforming file, which has the channel table.
types:
  file_header:
    doc: FILE_HEADER (§5.2)
    seq:
      - id: signature
        contents: [0x89, 'SCAR', 0x0d, 0x0a, 0x1a, 0x0a]
      - id: major
        type: u1
        valid: 0
      - id: minor
        type: u1
        valid: 2
      - id: version_reserved
        type: u1
        valid: 0
      - id: header_length
        type: u4
        valid:
          expr: _ >= 240 and _ <= 2280 and (_ - 104) % 136 == 0
      - id: file_length
        type: u8
        valid:
          max: 9007199254740991
      - id: profile
        type: u1
        enum: profile
        valid:
          in-enum: true
      - id: sh_degree
        type: u1
        valid:
          expr: _ <= 3 and (profile == profile::explicit or _ == 0)
      - id: layer_count
        type: u1
        valid:
          expr: 104 + 136 * _ == header_length
      - id: slots
        type: u1
        valid:
          expr: _ >= 1 and _ <= 32 and (profile == profile::anchor or _ == 1)
      - id: lattice_bits
        type: u1
        valid:
          min: 1
          max: 32
      - id: coordinate_frame
        type: u1
        enum: coordinate_frame
        valid:
          in-enum: true
      - id: colour_space
        type: u1
        enum: colour_space
        valid:
          in-enum: true
      - id: page_bits
        type: u1
        valid:
          max: 16
      - id: tile_count
        type: u4
        valid:
          max: 16777216
      - id: root_length
        type: u4
      - id: anchor_count
        type: u8
      - id: gaussian_count
        type: u8
      - id: origin
        type: f8
        repeat: expr
        repeat-expr: 3
      - id: voxel
        type: f8
        valid:
          expr: _ > 0.0
      - id: source_count
        type: u8
        valid:
          max: 9007199254740991
      - id: root_crc32
        type: u4
        doc: CRC-32 of ROOT (R-5.4-2)
  layer_summary:
    doc: LAYER_SUMMARY (§5.3); counts are cumulative
    params:
      - id: index
        type: u1
    seq:
      - id: anchor_count
        type: u8
      - id: gaussian_count
        type: u8
      - id: byte_count
        type: u8
      - id: end_offset
        type: u8
      - id: stream_bytes
        type: u8
        repeat: expr
        repeat-expr: 13
    instances:
      blocks:
        pos: end_offset - byte_count
        size: byte_count
        type: layer_blocks(index)
  root:
    doc: ROOT (§5.4)
    seq:
      - id: layers
        type: root_layer
        repeat: expr
        repeat-expr: _root.header.layer_count
      - id: pages
        type: root_page(_index)
        repeat: expr
        repeat-expr: _root.page_count
  root_layer:
    doc: The blocks of a layer that belong to no tile
    seq:
      - id: block_count
        type: varint
      - id: entries
        type: root_entry
        repeat: expr
        repeat-expr: block_count.value
  root_entry:
    seq:
      - id: kind
        type: u1
        enum: block_kind
        valid:
          expr: kind.to_i != 0 and kind != block_kind::tile
      - id: flags
        type: u1
        valid:
          max: 2
        doc: 1 critical, 2 safe-to-copy
      - id: length
        type: varint
      - id: count
        type: varint
      - id: crc32
        type: u4
  root_page:
    params:
      - id: index
        type: u4
    seq:
      - id: gap
        type: varint
      - id: tile_bytes
        type: varint
      - id: tile_crc32
        type: u4
      - id: rows
        type: root_rows
        repeat: expr
        repeat-expr: _root.header.layer_count
    instances:
      base:
        value: '(index == 0 ? 0 : _root.root.pages[index - 1].base.as<u8>) + gap.value'
        doc: Morton code at depth 21 where the first tile of the page begins
      size:
        value: '(index + 1) * _root.page_size > _root.header.tile_count ? _root.header.tile_count - index * _root.page_size : _root.page_size'
        doc: Tiles of the page
  root_rows:
    doc: What ROOT says of a row page; one of 0 bytes is not there
    seq:
      - id: row_bytes
        type: varint
      - id: row_crc32
        type: u4
        if: row_bytes.value > 0
      - id: block_bytes
        type: varint
        if: row_bytes.value > 0
      - id: anchors
        type: varint
        if: row_bytes.value > 0
  tile_page:
    doc: Cubes of the position lattice (§5.5)
    params:
      - id: index
        type: u4
    seq:
      - id: depths
        type: u1
        valid:
          max: 21
        repeat: expr
        repeat-expr: _root.root.pages[index].size
      - id: shifts
        type: u1
        valid:
          max: 31
        repeat: expr
        repeat-expr: _root.root.pages[index].size
      - id: gaps
        type: varint
        repeat: expr
        repeat-expr: _root.root.pages[index].size
    instances:
      tiles:
        type: tile(_index)
        repeat: expr
        repeat-expr: _root.root.pages[index].size
  tile:
    doc: A cube; its prefix follows from the gap and from where the one before ends
    params:
      - id: number
        type: u4
    instances:
      depth:
        value: _parent.as<tile_page>.depths[number]
      shift:
        value: _parent.as<tile_page>.shifts[number]
      local_bits:
        value: _root.header.lattice_bits - depth - shift
        doc: Bits per axis of a position within the tile, 0..21 (R-5.5-5)
      free:
        value: 3 * (21 - depth)
      before:
        value: 'number == 0 ? _root.root.pages[_parent.as<tile_page>.index].base.as<u8> : _parent.as<tile_page>.tiles[number - 1].past.as<u8>'
      prefix:
        value: ((before + (1 << free) - 1) >> free) + _parent.as<tile_page>.gaps[number].value
        doc: Morton code of the cube, 3 * depth bits
      past:
        value: (prefix + 1) << free
  layer_pages:
    doc: The row pages of a layer
    params:
      - id: layer
        type: u1
    seq:
      - id: pages
        type: row_page(layer, _index)
        size: _root.root.pages[_index].rows[layer].row_bytes.value
        repeat: expr
        repeat-expr: _root.page_count
  row_page:
    doc: The TILE blocks of a page in a layer (§5.5)
    params:
      - id: layer
        type: u1
      - id: index
        type: u4
    seq:
      - id: rows
        type: rows(_root.root.pages[index].size)
        if: not _io.eof
  rows:
    params:
      - id: size
        type: u4
    seq:
      - id: lengths
        type: varint
        repeat: expr
        repeat-expr: size
      - id: numbers
        size-eos: true
        doc: A count (varint) for every length that is not 0, then a CRC-32 (u4) for each
  layer_blocks:
    doc: The blocks of a layer, in the order of their kinds, those of tiles in the order of the tiles
    params:
      - id: layer
        type: u1
    seq:
      - id: models
        type: placed(layer, _index, false)
        repeat: expr
        repeat-expr: _root.root.layers[layer].block_count.value
      - id: tiles
        type: page_blocks(layer, _index)
        repeat: expr
        repeat-expr: _root.page_count
      - id: annotations
        type: placed(layer, _index, true)
        repeat: expr
        repeat-expr: _root.root.layers[layer].block_count.value
  placed:
    doc: A block of no tile, where blocks of its kind lie, before or behind those of tiles; elsewhere nothing
    params:
      - id: layer
        type: u1
      - id: number
        type: u1
      - id: behind
        type: bool
    seq:
      - id: body
        size: entry.length.value
        if: (entry.kind.to_i > 16) == behind
        type:
          switch-on: entry.kind
          cases:
            'block_kind::layer': layer_block(layer + 1)
            'block_kind::hash_grid': hash_grid_block
            'block_kind::streaming': streaming_block
            _: raw_block
    instances:
      entry:
        value: _root.root.layers[layer].entries[number]
  page_blocks:
    doc: The TILE blocks of a page in a layer
    params:
      - id: layer
        type: u1
      - id: index
        type: u4
    seq:
      - id: blocks
        type: placed_tile(layer, index, _index)
        repeat: expr
        repeat-expr: '_root.root.pages[index].rows[layer].row_bytes.value == 0 ? 0 : _root.root.pages[index].size'
  placed_tile:
    params:
      - id: layer
        type: u1
      - id: index
        type: u4
      - id: number
        type: u4
    seq:
      - id: body
        size: length
        if: length > 0
        type: tile_block
    instances:
      length:
        value: _root.row_pages[layer].pages[index].rows.lengths[number].value
  raw_block:
    doc: A Zstandard frame (TABLES, DECODER_MLP, SCENE_MLP), Rice codes, JSON (METADATA), or of a kind not known here
    seq:
      - id: bytes
        size-eos: true
  layer_block:
    doc: LAYER (§7.11); the channel table and the decoded context are those of layer 1
    params:
      - id: layer
        type: u1
    seq:
      - id: entropy_mode
        type: u1
        enum: entropy_mode
      - id: channel_count
        type: varint
        if: layer == 1
      - id: channels
        type: channel
        repeat: expr
        repeat-expr: channel_count.value
        if: layer == 1
      - id: passes_log2
        type: u1
        if: layer == 1
      - id: target_count
        type: varint
        if: layer == 1
      - id: targets
        type: varint
        repeat: expr
        repeat-expr: target_count.value
        if: layer == 1
      - id: class_count
        type: varint
      - id: classes
        type: class_row(channels_of_rows)
        repeat: expr
        repeat-expr: class_count.value
    instances:
      channels_of_rows:
        value: 'layer == 1 ? channel_count.value : _root.first_layer_block.channel_count.value'
  channel:
    doc: A row of the channel table (§6.4)
    seq:
      - id: stream
        type: u1
        enum: stream
      - id: components
        type: u1
      - id: rules
        type: component
        repeat: expr
        repeat-expr: components
  component:
    doc: First cell width and context rule of a component (§6.4, §8.4)
    seq:
      - id: first_width
        type: f8
      - id: by_class
        type: u1
      - id: source_channel
        type: u1
        doc: 255 for none
      - id: source_component
        type: u1
      - id: shift
        type: u1
      - id: low
        type: varint
        doc: zigzag; its number is signed_value
  class_row:
    doc: Stages and steps that anchors of a class have after this layer (§6.5)
    params:
      - id: channel_count
        type: u8
    seq:
      - id: stages
        type: u1
      - id: steps
        type: u1
        repeat: expr
        repeat-expr: channel_count
  tile_block:
    doc: TILE (§7.1)
    seq:
      - id: record_count
        type: u1
        valid:
          max: 11
      - id: records
        type: substream_record
        repeat: expr
        repeat-expr: record_count
      - id: table_crc32
        type: u4
      - id: substreams
        type: rans_stream(records[_index].length)
        repeat: expr
        repeat-expr: record_count
  substream_record:
    doc: SUBSTREAM_RECORD (§7.1)
    seq:
      - id: stream
        type: u1
        enum: stream
      - id: length
        type: u4
        valid:
          expr: _ > 0 and _ % 4 == 0
      - id: crc32
        type: u4
  rans_stream:
    doc: Words of a rANS stream (§8.2); the last is taken first
    params:
      - id: length
        type: u4
    seq:
      - id: words
        type: u4
        repeat: expr
        repeat-expr: length / 4
  streaming_block:
    doc: STREAMING (§7.13)
    seq:
      - id: layer_count
        type: u1
        valid:
          min: 1
          max: 16
      - id: tile_count
        type: varint
      - id: view_count
        type: varint
      - id: view
        type: f4
        repeat: expr
        repeat-expr: view_count.value * 10
        doc: position, target, up, vertical field in radians
      - id: viewpoint_count
        type: varint
      - id: viewpoints
        type: f4
        repeat: expr
        repeat-expr: viewpoint_count.value * 3
      - id: low
        size: tile_count.value * 3
      - id: high
        size: tile_count.value * 3
      - id: reach
        size: tile_count.value
      - id: gains
        size: viewpoint_count.value * layer_count * tile_count.value
  hash_grid_block:
    doc: HASH_GRID (§10.6)
    seq:
      - id: origin
        type: varint
        repeat: expr
        repeat-expr: 3
      - id: extent_bits
        type: varint
      - id: level_count
        type: varint
      - id: levels
        type: grid_level
        repeat: expr
        repeat-expr: level_count.value
      - id: streams
        type: grid_stream
        repeat: expr
        repeat-expr: level_count.value
  grid_level:
    seq:
      - id: plane
        type: varint
      - id: resolution
        type: varint
      - id: table_log2
        type: varint
      - id: features
        type: varint
  grid_stream:
    seq:
      - id: ones
        type: u1
      - id: length
        type: u4
      - id: stream
        size: length
  varint:
    doc: LEB128 of at most 63 bits (§5.7); that it is as short as possible is not checked here
    seq:
      - id: groups
        type: u1
        repeat: until
        repeat-until: _ < 0x80 or _index == 9
    instances:
      last:
        value: groups.size - 1
      value:
        value: >-
          (groups[0] & 0x7f)
          | (last >= 1 ? (groups[1] & 0x7f) << 7 : 0)
          | (last >= 2 ? (groups[2] & 0x7f) << 14 : 0)
          | (last >= 3 ? (groups[3] & 0x7f) << 21 : 0)
          | (last >= 4 ? (groups[4] & 0x7f) << 28 : 0)
          | (last >= 5 ? (groups[5] & 0x7f) << 35 : 0)
          | (last >= 6 ? (groups[6] & 0x7f) << 42 : 0)
          | (last >= 7 ? (groups[7] & 0x7f) << 49 : 0)
          | (last >= 8 ? (groups[8] & 0x7f) << 56 : 0)
      signed_value:
        value: '(value & 1) == 0 ? value >> 1 : -(value >> 1) - 1'
        doc: svarint of §5.7
enums:
  profile:
    0: explicit
    1: anchor
  coordinate_frame:
    0: unspecified
    1: rdf
    2: rub
  colour_space:
    0: unspecified
    1: srgb
    2: linear
  entropy_mode:
    0: static
    1: neural
  block_kind:
    1: layer
    2: tables
    3: codebooks
    4: decoder_mlp
    5: scene_mlp
    6: hash_grid
    7: entropy_network
    8: predictors
    16: tile
    64: metadata
    65: streaming
  stream:
    0: models
    1: positions
    2: classes
    3: masks
    4: position_residual
    5: scale
    6: rotation
    7: opacity
    8: colour
    9: indices
    10: latent
    11: offsets
    12: framing
