# Made by `make ksy` from scar.ksy, sha256 9298fca88752bf20c217bcbf4373d8cb4c9b1f46f49c104adaebab55b51d9edf
# This is a generated file! Please edit source .ksy file and use kaitai-struct-compiler to rebuild
# type: ignore

import kaitaistruct
from kaitaistruct import KaitaiStruct, KaitaiStream, BytesIO
from enum import IntEnum


if getattr(kaitaistruct, 'API_VERSION', (0, 9)) < (0, 11):
    raise Exception("Incompatible Kaitai Struct Python API: 0.11 or later is required, but you have %s" % (kaitaistruct.__version__))

class Scar(KaitaiStruct):
    """A scene of 3D Gaussians in layers. Header, ROOT and pages say where every block lies; blocks are in the order in which
    a reader wants them, layer by layer, so a file cut after a layer is that scene, coarser.
    
    .. seealso::
       SPEC.md
    """

    class BlockKind(IntEnum):
        layer = 1
        tables = 2
        codebooks = 3
        decoder_mlp = 4
        scene_mlp = 5
        hash_grid = 6
        entropy_network = 7
        predictors = 8
        tile = 16
        metadata = 64
        streaming = 65

    class ColourSpace(IntEnum):
        unspecified = 0
        srgb = 1
        linear = 2

    class CoordinateFrame(IntEnum):
        unspecified = 0
        rdf = 1
        rub = 2

    class EntropyMode(IntEnum):
        static = 0
        neural = 1

    class Profile(IntEnum):
        explicit = 0
        anchor = 1

    class Stream(IntEnum):
        models = 0
        positions = 1
        classes = 2
        masks = 3
        position_residual = 4
        scale = 5
        rotation = 6
        opacity = 7
        colour = 8
        indices = 9
        latent = 10
        offsets = 11
        framing = 12
    def __init__(self, _io, _parent=None, _root=None):
        super(Scar, self).__init__(_io)
        self._parent = _parent
        self._root = _root or self
        self._read()

    def _read(self):
        self.header = Scar.FileHeader(self._io, self, self._root)
        self.layers = []
        for i in range(self.header.layer_count):
            self.layers.append(Scar.LayerSummary(i, self._io, self, self._root))

        self.header_crc32 = self._io.read_u4le()
        self._raw_root = self._io.read_bytes(self.header.root_length)
        _io__raw_root = KaitaiStream(BytesIO(self._raw_root))
        self.root = Scar.Root(_io__raw_root, self, self._root)
        self._raw_tile_pages = []
        self.tile_pages = []
        for i in range(self.page_count):
            self._raw_tile_pages.append(self._io.read_bytes(self.root.pages[i].tile_bytes.value))
            _io__raw_tile_pages = KaitaiStream(BytesIO(self._raw_tile_pages[i]))
            self.tile_pages.append(Scar.TilePage(i, _io__raw_tile_pages, self, self._root))

        self.row_pages = []
        for i in range(self.header.layer_count):
            self.row_pages.append(Scar.LayerPages(i, self._io, self, self._root))



    def _fetch_instances(self):
        pass
        self.header._fetch_instances()
        for i in range(len(self.layers)):
            pass
            self.layers[i]._fetch_instances()

        self.root._fetch_instances()
        for i in range(len(self.tile_pages)):
            pass
            self.tile_pages[i]._fetch_instances()

        for i in range(len(self.row_pages)):
            pass
            self.row_pages[i]._fetch_instances()


    class Channel(KaitaiStruct):
        """A row of the channel table (§6.4)."""
        def __init__(self, _io, _parent=None, _root=None):
            super(Scar.Channel, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self._read()

        def _read(self):
            self.stream = KaitaiStream.resolve_enum(Scar.Stream, self._io.read_u1())
            self.components = self._io.read_u1()
            self.rules = []
            for i in range(self.components):
                self.rules.append(Scar.Component(self._io, self, self._root))



        def _fetch_instances(self):
            pass
            for i in range(len(self.rules)):
                pass
                self.rules[i]._fetch_instances()



    class ClassRow(KaitaiStruct):
        """Stages and steps that anchors of a class have after this layer (§6.5)."""
        def __init__(self, channel_count, _io, _parent=None, _root=None):
            super(Scar.ClassRow, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self.channel_count = channel_count
            self._read()

        def _read(self):
            self.stages = self._io.read_u1()
            self.steps = []
            for i in range(self.channel_count):
                self.steps.append(self._io.read_u1())



        def _fetch_instances(self):
            pass
            for i in range(len(self.steps)):
                pass



    class Component(KaitaiStruct):
        """First cell width and context rule of a component (§6.4, §8.4)."""
        def __init__(self, _io, _parent=None, _root=None):
            super(Scar.Component, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self._read()

        def _read(self):
            self.first_width = self._io.read_f8le()
            self.by_class = self._io.read_u1()
            self.source_channel = self._io.read_u1()
            self.source_component = self._io.read_u1()
            self.shift = self._io.read_u1()
            self.low = Scar.Varint(self._io, self, self._root)


        def _fetch_instances(self):
            pass
            self.low._fetch_instances()


    class FileHeader(KaitaiStruct):
        """FILE_HEADER (§5.2)."""
        def __init__(self, _io, _parent=None, _root=None):
            super(Scar.FileHeader, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self._read()

        def _read(self):
            self.signature = self._io.read_bytes(9)
            if not self.signature == b"\x89\x53\x43\x41\x52\x0D\x0A\x1A\x0A":
                raise kaitaistruct.ValidationNotEqualError(b"\x89\x53\x43\x41\x52\x0D\x0A\x1A\x0A", self.signature, self._io, u"/types/file_header/seq/0")
            self.major = self._io.read_u1()
            if not self.major == 0:
                raise kaitaistruct.ValidationNotEqualError(0, self.major, self._io, u"/types/file_header/seq/1")
            self.minor = self._io.read_u1()
            if not self.minor == 2:
                raise kaitaistruct.ValidationNotEqualError(2, self.minor, self._io, u"/types/file_header/seq/2")
            self.version_reserved = self._io.read_u1()
            if not self.version_reserved == 0:
                raise kaitaistruct.ValidationNotEqualError(0, self.version_reserved, self._io, u"/types/file_header/seq/3")
            self.header_length = self._io.read_u4le()
            _ = self.header_length
            if not  ((_ >= 240) and (_ <= 2280) and ((_ - 104) % 136 == 0)) :
                raise kaitaistruct.ValidationExprError(self.header_length, self._io, u"/types/file_header/seq/4")
            self.file_length = self._io.read_u8le()
            if not self.file_length <= 9007199254740991:
                raise kaitaistruct.ValidationGreaterThanError(9007199254740991, self.file_length, self._io, u"/types/file_header/seq/5")
            self.profile = KaitaiStream.resolve_enum(Scar.Profile, self._io.read_u1())
            if not isinstance(self.profile, Scar.Profile):
                raise kaitaistruct.ValidationNotInEnumError(self.profile, self._io, u"/types/file_header/seq/6")
            self.sh_degree = self._io.read_u1()
            _ = self.sh_degree
            if not  ((_ <= 3) and ( ((self.profile == Scar.Profile.explicit) or (_ == 0)) )) :
                raise kaitaistruct.ValidationExprError(self.sh_degree, self._io, u"/types/file_header/seq/7")
            self.layer_count = self._io.read_u1()
            _ = self.layer_count
            if not 104 + 136 * _ == self.header_length:
                raise kaitaistruct.ValidationExprError(self.layer_count, self._io, u"/types/file_header/seq/8")
            self.slots = self._io.read_u1()
            _ = self.slots
            if not  ((_ >= 1) and (_ <= 32) and ( ((self.profile == Scar.Profile.anchor) or (_ == 1)) )) :
                raise kaitaistruct.ValidationExprError(self.slots, self._io, u"/types/file_header/seq/9")
            self.lattice_bits = self._io.read_u1()
            if not self.lattice_bits >= 1:
                raise kaitaistruct.ValidationLessThanError(1, self.lattice_bits, self._io, u"/types/file_header/seq/10")
            if not self.lattice_bits <= 32:
                raise kaitaistruct.ValidationGreaterThanError(32, self.lattice_bits, self._io, u"/types/file_header/seq/10")
            self.coordinate_frame = KaitaiStream.resolve_enum(Scar.CoordinateFrame, self._io.read_u1())
            if not isinstance(self.coordinate_frame, Scar.CoordinateFrame):
                raise kaitaistruct.ValidationNotInEnumError(self.coordinate_frame, self._io, u"/types/file_header/seq/11")
            self.colour_space = KaitaiStream.resolve_enum(Scar.ColourSpace, self._io.read_u1())
            if not isinstance(self.colour_space, Scar.ColourSpace):
                raise kaitaistruct.ValidationNotInEnumError(self.colour_space, self._io, u"/types/file_header/seq/12")
            self.page_bits = self._io.read_u1()
            if not self.page_bits <= 16:
                raise kaitaistruct.ValidationGreaterThanError(16, self.page_bits, self._io, u"/types/file_header/seq/13")
            self.tile_count = self._io.read_u4le()
            if not self.tile_count <= 16777216:
                raise kaitaistruct.ValidationGreaterThanError(16777216, self.tile_count, self._io, u"/types/file_header/seq/14")
            self.root_length = self._io.read_u4le()
            self.anchor_count = self._io.read_u8le()
            self.gaussian_count = self._io.read_u8le()
            self.origin = []
            for i in range(3):
                self.origin.append(self._io.read_f8le())

            self.voxel = self._io.read_f8le()
            _ = self.voxel
            if not _ > 0.0:
                raise kaitaistruct.ValidationExprError(self.voxel, self._io, u"/types/file_header/seq/19")
            self.source_count = self._io.read_u8le()
            if not self.source_count <= 9007199254740991:
                raise kaitaistruct.ValidationGreaterThanError(9007199254740991, self.source_count, self._io, u"/types/file_header/seq/20")
            self.root_crc32 = self._io.read_u4le()


        def _fetch_instances(self):
            pass
            for i in range(len(self.origin)):
                pass



    class GridLevel(KaitaiStruct):
        def __init__(self, _io, _parent=None, _root=None):
            super(Scar.GridLevel, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self._read()

        def _read(self):
            self.plane = Scar.Varint(self._io, self, self._root)
            self.resolution = Scar.Varint(self._io, self, self._root)
            self.table_log2 = Scar.Varint(self._io, self, self._root)
            self.features = Scar.Varint(self._io, self, self._root)


        def _fetch_instances(self):
            pass
            self.plane._fetch_instances()
            self.resolution._fetch_instances()
            self.table_log2._fetch_instances()
            self.features._fetch_instances()


    class GridStream(KaitaiStruct):
        def __init__(self, _io, _parent=None, _root=None):
            super(Scar.GridStream, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self._read()

        def _read(self):
            self.ones = self._io.read_u1()
            self.length = self._io.read_u4le()
            self.stream = self._io.read_bytes(self.length)


        def _fetch_instances(self):
            pass


    class HashGridBlock(KaitaiStruct):
        """HASH_GRID (§10.6)."""
        def __init__(self, _io, _parent=None, _root=None):
            super(Scar.HashGridBlock, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self._read()

        def _read(self):
            self.origin = []
            for i in range(3):
                self.origin.append(Scar.Varint(self._io, self, self._root))

            self.extent_bits = Scar.Varint(self._io, self, self._root)
            self.level_count = Scar.Varint(self._io, self, self._root)
            self.levels = []
            for i in range(self.level_count.value):
                self.levels.append(Scar.GridLevel(self._io, self, self._root))

            self.streams = []
            for i in range(self.level_count.value):
                self.streams.append(Scar.GridStream(self._io, self, self._root))



        def _fetch_instances(self):
            pass
            for i in range(len(self.origin)):
                pass
                self.origin[i]._fetch_instances()

            self.extent_bits._fetch_instances()
            self.level_count._fetch_instances()
            for i in range(len(self.levels)):
                pass
                self.levels[i]._fetch_instances()

            for i in range(len(self.streams)):
                pass
                self.streams[i]._fetch_instances()



    class LayerBlock(KaitaiStruct):
        """LAYER (§7.11); the channel table and the decoded context are those of layer 1."""
        def __init__(self, layer, _io, _parent=None, _root=None):
            super(Scar.LayerBlock, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self.layer = layer
            self._read()

        def _read(self):
            self.entropy_mode = KaitaiStream.resolve_enum(Scar.EntropyMode, self._io.read_u1())
            if self.layer == 1:
                pass
                self.channel_count = Scar.Varint(self._io, self, self._root)

            if self.layer == 1:
                pass
                self.channels = []
                for i in range(self.channel_count.value):
                    self.channels.append(Scar.Channel(self._io, self, self._root))


            if self.layer == 1:
                pass
                self.passes_log2 = self._io.read_u1()

            if self.layer == 1:
                pass
                self.target_count = Scar.Varint(self._io, self, self._root)

            if self.layer == 1:
                pass
                self.targets = []
                for i in range(self.target_count.value):
                    self.targets.append(Scar.Varint(self._io, self, self._root))


            self.class_count = Scar.Varint(self._io, self, self._root)
            self.classes = []
            for i in range(self.class_count.value):
                self.classes.append(Scar.ClassRow(self.channels_of_rows, self._io, self, self._root))



        def _fetch_instances(self):
            pass
            if self.layer == 1:
                pass
                self.channel_count._fetch_instances()

            if self.layer == 1:
                pass
                for i in range(len(self.channels)):
                    pass
                    self.channels[i]._fetch_instances()


            if self.layer == 1:
                pass

            if self.layer == 1:
                pass
                self.target_count._fetch_instances()

            if self.layer == 1:
                pass
                for i in range(len(self.targets)):
                    pass
                    self.targets[i]._fetch_instances()


            self.class_count._fetch_instances()
            for i in range(len(self.classes)):
                pass
                self.classes[i]._fetch_instances()


        @property
        def channels_of_rows(self):
            if hasattr(self, '_m_channels_of_rows'):
                return self._m_channels_of_rows

            self._m_channels_of_rows = (self.channel_count.value if self.layer == 1 else self._root.first_layer_block.channel_count.value)
            return getattr(self, '_m_channels_of_rows', None)


    class LayerBlocks(KaitaiStruct):
        """The blocks of a layer, in the order of their kinds, those of tiles in the order of the tiles."""
        def __init__(self, layer, _io, _parent=None, _root=None):
            super(Scar.LayerBlocks, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self.layer = layer
            self._read()

        def _read(self):
            self.models = []
            for i in range(self._root.root.layers[self.layer].block_count.value):
                self.models.append(Scar.Placed(self.layer, i, False, self._io, self, self._root))

            self.tiles = []
            for i in range(self._root.page_count):
                self.tiles.append(Scar.PageBlocks(self.layer, i, self._io, self, self._root))

            self.annotations = []
            for i in range(self._root.root.layers[self.layer].block_count.value):
                self.annotations.append(Scar.Placed(self.layer, i, True, self._io, self, self._root))



        def _fetch_instances(self):
            pass
            for i in range(len(self.models)):
                pass
                self.models[i]._fetch_instances()

            for i in range(len(self.tiles)):
                pass
                self.tiles[i]._fetch_instances()

            for i in range(len(self.annotations)):
                pass
                self.annotations[i]._fetch_instances()



    class LayerPages(KaitaiStruct):
        """The row pages of a layer."""
        def __init__(self, layer, _io, _parent=None, _root=None):
            super(Scar.LayerPages, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self.layer = layer
            self._read()

        def _read(self):
            self._raw_pages = []
            self.pages = []
            for i in range(self._root.page_count):
                self._raw_pages.append(self._io.read_bytes(self._root.root.pages[i].rows[self.layer].row_bytes.value))
                _io__raw_pages = KaitaiStream(BytesIO(self._raw_pages[i]))
                self.pages.append(Scar.RowPage(self.layer, i, _io__raw_pages, self, self._root))



        def _fetch_instances(self):
            pass
            for i in range(len(self.pages)):
                pass
                self.pages[i]._fetch_instances()



    class LayerSummary(KaitaiStruct):
        """LAYER_SUMMARY (§5.3); counts are cumulative."""
        def __init__(self, index, _io, _parent=None, _root=None):
            super(Scar.LayerSummary, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self.index = index
            self._read()

        def _read(self):
            self.anchor_count = self._io.read_u8le()
            self.gaussian_count = self._io.read_u8le()
            self.byte_count = self._io.read_u8le()
            self.end_offset = self._io.read_u8le()
            self.stream_bytes = []
            for i in range(13):
                self.stream_bytes.append(self._io.read_u8le())



        def _fetch_instances(self):
            pass
            for i in range(len(self.stream_bytes)):
                pass

            _ = self.blocks
            if hasattr(self, '_m_blocks'):
                pass
                self._m_blocks._fetch_instances()


        @property
        def blocks(self):
            if hasattr(self, '_m_blocks'):
                return self._m_blocks

            _pos = self._io.pos()
            self._io.seek(self.end_offset - self.byte_count)
            self._raw__m_blocks = self._io.read_bytes(self.byte_count)
            _io__raw__m_blocks = KaitaiStream(BytesIO(self._raw__m_blocks))
            self._m_blocks = Scar.LayerBlocks(self.index, _io__raw__m_blocks, self, self._root)
            self._io.seek(_pos)
            return getattr(self, '_m_blocks', None)


    class PageBlocks(KaitaiStruct):
        """The TILE blocks of a page in a layer."""
        def __init__(self, layer, index, _io, _parent=None, _root=None):
            super(Scar.PageBlocks, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self.layer = layer
            self.index = index
            self._read()

        def _read(self):
            self.blocks = []
            for i in range((0 if self._root.root.pages[self.index].rows[self.layer].row_bytes.value == 0 else self._root.root.pages[self.index].size)):
                self.blocks.append(Scar.PlacedTile(self.layer, self.index, i, self._io, self, self._root))



        def _fetch_instances(self):
            pass
            for i in range(len(self.blocks)):
                pass
                self.blocks[i]._fetch_instances()



    class Placed(KaitaiStruct):
        """A block of no tile, where blocks of its kind lie, before or behind those of tiles; elsewhere nothing."""
        def __init__(self, layer, number, behind, _io, _parent=None, _root=None):
            super(Scar.Placed, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self.layer = layer
            self.number = number
            self.behind = behind
            self._read()

        def _read(self):
            if (int(self.entry.kind) > 16) == self.behind:
                pass
                _on = self.entry.kind
                if _on == Scar.BlockKind.hash_grid:
                    pass
                    self._raw_body = self._io.read_bytes(self.entry.length.value)
                    _io__raw_body = KaitaiStream(BytesIO(self._raw_body))
                    self.body = Scar.HashGridBlock(_io__raw_body, self, self._root)
                elif _on == Scar.BlockKind.layer:
                    pass
                    self._raw_body = self._io.read_bytes(self.entry.length.value)
                    _io__raw_body = KaitaiStream(BytesIO(self._raw_body))
                    self.body = Scar.LayerBlock(self.layer + 1, _io__raw_body, self, self._root)
                elif _on == Scar.BlockKind.streaming:
                    pass
                    self._raw_body = self._io.read_bytes(self.entry.length.value)
                    _io__raw_body = KaitaiStream(BytesIO(self._raw_body))
                    self.body = Scar.StreamingBlock(_io__raw_body, self, self._root)
                else:
                    pass
                    self._raw_body = self._io.read_bytes(self.entry.length.value)
                    _io__raw_body = KaitaiStream(BytesIO(self._raw_body))
                    self.body = Scar.RawBlock(_io__raw_body, self, self._root)



        def _fetch_instances(self):
            pass
            if (int(self.entry.kind) > 16) == self.behind:
                pass
                _on = self.entry.kind
                if _on == Scar.BlockKind.hash_grid:
                    pass
                    self.body._fetch_instances()
                elif _on == Scar.BlockKind.layer:
                    pass
                    self.body._fetch_instances()
                elif _on == Scar.BlockKind.streaming:
                    pass
                    self.body._fetch_instances()
                else:
                    pass
                    self.body._fetch_instances()


        @property
        def entry(self):
            if hasattr(self, '_m_entry'):
                return self._m_entry

            self._m_entry = self._root.root.layers[self.layer].entries[self.number]
            return getattr(self, '_m_entry', None)


    class PlacedTile(KaitaiStruct):
        def __init__(self, layer, index, number, _io, _parent=None, _root=None):
            super(Scar.PlacedTile, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self.layer = layer
            self.index = index
            self.number = number
            self._read()

        def _read(self):
            if self.length > 0:
                pass
                self._raw_body = self._io.read_bytes(self.length)
                _io__raw_body = KaitaiStream(BytesIO(self._raw_body))
                self.body = Scar.TileBlock(_io__raw_body, self, self._root)



        def _fetch_instances(self):
            pass
            if self.length > 0:
                pass
                self.body._fetch_instances()


        @property
        def length(self):
            if hasattr(self, '_m_length'):
                return self._m_length

            self._m_length = self._root.row_pages[self.layer].pages[self.index].rows.lengths[self.number].value
            return getattr(self, '_m_length', None)


    class RansStream(KaitaiStruct):
        """Words of a rANS stream (§8.2); the last is taken first."""
        def __init__(self, length, _io, _parent=None, _root=None):
            super(Scar.RansStream, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self.length = length
            self._read()

        def _read(self):
            self.words = []
            for i in range(self.length // 4):
                self.words.append(self._io.read_u4le())



        def _fetch_instances(self):
            pass
            for i in range(len(self.words)):
                pass



    class RawBlock(KaitaiStruct):
        """A Zstandard frame (TABLES, DECODER_MLP, SCENE_MLP), Rice codes, JSON (METADATA), or of a kind not known here."""
        def __init__(self, _io, _parent=None, _root=None):
            super(Scar.RawBlock, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self._read()

        def _read(self):
            self.bytes = self._io.read_bytes_full()


        def _fetch_instances(self):
            pass


    class Root(KaitaiStruct):
        """ROOT (§5.4)."""
        def __init__(self, _io, _parent=None, _root=None):
            super(Scar.Root, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self._read()

        def _read(self):
            self.layers = []
            for i in range(self._root.header.layer_count):
                self.layers.append(Scar.RootLayer(self._io, self, self._root))

            self.pages = []
            for i in range(self._root.page_count):
                self.pages.append(Scar.RootPage(i, self._io, self, self._root))



        def _fetch_instances(self):
            pass
            for i in range(len(self.layers)):
                pass
                self.layers[i]._fetch_instances()

            for i in range(len(self.pages)):
                pass
                self.pages[i]._fetch_instances()



    class RootEntry(KaitaiStruct):
        def __init__(self, _io, _parent=None, _root=None):
            super(Scar.RootEntry, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self._read()

        def _read(self):
            self.kind = KaitaiStream.resolve_enum(Scar.BlockKind, self._io.read_u1())
            _ = self.kind
            if not  ((int(self.kind) != 0) and (self.kind != Scar.BlockKind.tile)) :
                raise kaitaistruct.ValidationExprError(self.kind, self._io, u"/types/root_entry/seq/0")
            self.flags = self._io.read_u1()
            if not self.flags <= 2:
                raise kaitaistruct.ValidationGreaterThanError(2, self.flags, self._io, u"/types/root_entry/seq/1")
            self.length = Scar.Varint(self._io, self, self._root)
            self.count = Scar.Varint(self._io, self, self._root)
            self.crc32 = self._io.read_u4le()


        def _fetch_instances(self):
            pass
            self.length._fetch_instances()
            self.count._fetch_instances()


    class RootLayer(KaitaiStruct):
        """The blocks of a layer that belong to no tile."""
        def __init__(self, _io, _parent=None, _root=None):
            super(Scar.RootLayer, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self._read()

        def _read(self):
            self.block_count = Scar.Varint(self._io, self, self._root)
            self.entries = []
            for i in range(self.block_count.value):
                self.entries.append(Scar.RootEntry(self._io, self, self._root))



        def _fetch_instances(self):
            pass
            self.block_count._fetch_instances()
            for i in range(len(self.entries)):
                pass
                self.entries[i]._fetch_instances()



    class RootPage(KaitaiStruct):
        def __init__(self, index, _io, _parent=None, _root=None):
            super(Scar.RootPage, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self.index = index
            self._read()

        def _read(self):
            self.gap = Scar.Varint(self._io, self, self._root)
            self.tile_bytes = Scar.Varint(self._io, self, self._root)
            self.tile_crc32 = self._io.read_u4le()
            self.rows = []
            for i in range(self._root.header.layer_count):
                self.rows.append(Scar.RootRows(self._io, self, self._root))



        def _fetch_instances(self):
            pass
            self.gap._fetch_instances()
            self.tile_bytes._fetch_instances()
            for i in range(len(self.rows)):
                pass
                self.rows[i]._fetch_instances()


        @property
        def base(self):
            """Morton code at depth 21 where the first tile of the page begins."""
            if hasattr(self, '_m_base'):
                return self._m_base

            self._m_base = (0 if self.index == 0 else self._root.root.pages[self.index - 1].base) + self.gap.value
            return getattr(self, '_m_base', None)

        @property
        def size(self):
            """Tiles of the page."""
            if hasattr(self, '_m_size'):
                return self._m_size

            self._m_size = (self._root.header.tile_count - self.index * self._root.page_size if (self.index + 1) * self._root.page_size > self._root.header.tile_count else self._root.page_size)
            return getattr(self, '_m_size', None)


    class RootRows(KaitaiStruct):
        """What ROOT says of a row page; one of 0 bytes is not there."""
        def __init__(self, _io, _parent=None, _root=None):
            super(Scar.RootRows, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self._read()

        def _read(self):
            self.row_bytes = Scar.Varint(self._io, self, self._root)
            if self.row_bytes.value > 0:
                pass
                self.row_crc32 = self._io.read_u4le()

            if self.row_bytes.value > 0:
                pass
                self.block_bytes = Scar.Varint(self._io, self, self._root)

            if self.row_bytes.value > 0:
                pass
                self.anchors = Scar.Varint(self._io, self, self._root)



        def _fetch_instances(self):
            pass
            self.row_bytes._fetch_instances()
            if self.row_bytes.value > 0:
                pass

            if self.row_bytes.value > 0:
                pass
                self.block_bytes._fetch_instances()

            if self.row_bytes.value > 0:
                pass
                self.anchors._fetch_instances()



    class RowPage(KaitaiStruct):
        """The TILE blocks of a page in a layer (§5.5)."""
        def __init__(self, layer, index, _io, _parent=None, _root=None):
            super(Scar.RowPage, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self.layer = layer
            self.index = index
            self._read()

        def _read(self):
            if (not (self._io.is_eof())):
                pass
                self.rows = Scar.Rows(self._root.root.pages[self.index].size, self._io, self, self._root)



        def _fetch_instances(self):
            pass
            if (not (self._io.is_eof())):
                pass
                self.rows._fetch_instances()



    class Rows(KaitaiStruct):
        def __init__(self, size, _io, _parent=None, _root=None):
            super(Scar.Rows, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self.size = size
            self._read()

        def _read(self):
            self.lengths = []
            for i in range(self.size):
                self.lengths.append(Scar.Varint(self._io, self, self._root))

            self.numbers = self._io.read_bytes_full()


        def _fetch_instances(self):
            pass
            for i in range(len(self.lengths)):
                pass
                self.lengths[i]._fetch_instances()



    class StreamingBlock(KaitaiStruct):
        """STREAMING (§7.13)."""
        def __init__(self, _io, _parent=None, _root=None):
            super(Scar.StreamingBlock, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self._read()

        def _read(self):
            self.layer_count = self._io.read_u1()
            if not self.layer_count >= 1:
                raise kaitaistruct.ValidationLessThanError(1, self.layer_count, self._io, u"/types/streaming_block/seq/0")
            if not self.layer_count <= 16:
                raise kaitaistruct.ValidationGreaterThanError(16, self.layer_count, self._io, u"/types/streaming_block/seq/0")
            self.tile_count = Scar.Varint(self._io, self, self._root)
            self.view_count = Scar.Varint(self._io, self, self._root)
            self.view = []
            for i in range(self.view_count.value * 10):
                self.view.append(self._io.read_f4le())

            self.viewpoint_count = Scar.Varint(self._io, self, self._root)
            self.viewpoints = []
            for i in range(self.viewpoint_count.value * 3):
                self.viewpoints.append(self._io.read_f4le())

            self.low = self._io.read_bytes(self.tile_count.value * 3)
            self.high = self._io.read_bytes(self.tile_count.value * 3)
            self.reach = self._io.read_bytes(self.tile_count.value)
            self.gains = self._io.read_bytes((self.viewpoint_count.value * self.layer_count) * self.tile_count.value)


        def _fetch_instances(self):
            pass
            self.tile_count._fetch_instances()
            self.view_count._fetch_instances()
            for i in range(len(self.view)):
                pass

            self.viewpoint_count._fetch_instances()
            for i in range(len(self.viewpoints)):
                pass



    class SubstreamRecord(KaitaiStruct):
        """SUBSTREAM_RECORD (§7.1)."""
        def __init__(self, _io, _parent=None, _root=None):
            super(Scar.SubstreamRecord, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self._read()

        def _read(self):
            self.stream = KaitaiStream.resolve_enum(Scar.Stream, self._io.read_u1())
            self.length = self._io.read_u4le()
            _ = self.length
            if not  ((_ > 0) and (_ % 4 == 0)) :
                raise kaitaistruct.ValidationExprError(self.length, self._io, u"/types/substream_record/seq/1")
            self.crc32 = self._io.read_u4le()


        def _fetch_instances(self):
            pass


    class Tile(KaitaiStruct):
        """A cube; its prefix follows from the gap and from where the one before ends."""
        def __init__(self, number, _io, _parent=None, _root=None):
            super(Scar.Tile, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self.number = number
            self._read()

        def _read(self):
            pass


        def _fetch_instances(self):
            pass

        @property
        def before(self):
            if hasattr(self, '_m_before'):
                return self._m_before

            self._m_before = (self._root.root.pages[self._parent.index].base if self.number == 0 else self._parent.tiles[self.number - 1].past)
            return getattr(self, '_m_before', None)

        @property
        def depth(self):
            if hasattr(self, '_m_depth'):
                return self._m_depth

            self._m_depth = self._parent.depths[self.number]
            return getattr(self, '_m_depth', None)

        @property
        def free(self):
            if hasattr(self, '_m_free'):
                return self._m_free

            self._m_free = 3 * (21 - self.depth)
            return getattr(self, '_m_free', None)

        @property
        def local_bits(self):
            """Bits per axis of a position within the tile, 0..21 (R-5.5-5)."""
            if hasattr(self, '_m_local_bits'):
                return self._m_local_bits

            self._m_local_bits = (self._root.header.lattice_bits - self.depth) - self.shift
            return getattr(self, '_m_local_bits', None)

        @property
        def past(self):
            if hasattr(self, '_m_past'):
                return self._m_past

            self._m_past = self.prefix + 1 << self.free
            return getattr(self, '_m_past', None)

        @property
        def prefix(self):
            """Morton code of the cube, 3 * depth bits."""
            if hasattr(self, '_m_prefix'):
                return self._m_prefix

            self._m_prefix = ((self.before + (1 << self.free)) - 1 >> self.free) + self._parent.gaps[self.number].value
            return getattr(self, '_m_prefix', None)

        @property
        def shift(self):
            if hasattr(self, '_m_shift'):
                return self._m_shift

            self._m_shift = self._parent.shifts[self.number]
            return getattr(self, '_m_shift', None)


    class TileBlock(KaitaiStruct):
        """TILE (§7.1)."""
        def __init__(self, _io, _parent=None, _root=None):
            super(Scar.TileBlock, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self._read()

        def _read(self):
            self.record_count = self._io.read_u1()
            if not self.record_count <= 11:
                raise kaitaistruct.ValidationGreaterThanError(11, self.record_count, self._io, u"/types/tile_block/seq/0")
            self.records = []
            for i in range(self.record_count):
                self.records.append(Scar.SubstreamRecord(self._io, self, self._root))

            self.table_crc32 = self._io.read_u4le()
            self.substreams = []
            for i in range(self.record_count):
                self.substreams.append(Scar.RansStream(self.records[i].length, self._io, self, self._root))



        def _fetch_instances(self):
            pass
            for i in range(len(self.records)):
                pass
                self.records[i]._fetch_instances()

            for i in range(len(self.substreams)):
                pass
                self.substreams[i]._fetch_instances()



    class TilePage(KaitaiStruct):
        """Cubes of the position lattice (§5.5)."""
        def __init__(self, index, _io, _parent=None, _root=None):
            super(Scar.TilePage, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self.index = index
            self._read()

        def _read(self):
            self.depths = []
            for i in range(self._root.root.pages[self.index].size):
                self.depths.append(self._io.read_u1())
                if not self.depths[i] <= 21:
                    raise kaitaistruct.ValidationGreaterThanError(21, self.depths[i], self._io, u"/types/tile_page/seq/0")

            self.shifts = []
            for i in range(self._root.root.pages[self.index].size):
                self.shifts.append(self._io.read_u1())
                if not self.shifts[i] <= 31:
                    raise kaitaistruct.ValidationGreaterThanError(31, self.shifts[i], self._io, u"/types/tile_page/seq/1")

            self.gaps = []
            for i in range(self._root.root.pages[self.index].size):
                self.gaps.append(Scar.Varint(self._io, self, self._root))



        def _fetch_instances(self):
            pass
            for i in range(len(self.depths)):
                pass

            for i in range(len(self.shifts)):
                pass

            for i in range(len(self.gaps)):
                pass
                self.gaps[i]._fetch_instances()

            _ = self.tiles
            if hasattr(self, '_m_tiles'):
                pass
                for i in range(len(self._m_tiles)):
                    pass
                    self._m_tiles[i]._fetch_instances()



        @property
        def tiles(self):
            if hasattr(self, '_m_tiles'):
                return self._m_tiles

            self._m_tiles = []
            for i in range(self._root.root.pages[self.index].size):
                self._m_tiles.append(Scar.Tile(i, self._io, self, self._root))

            return getattr(self, '_m_tiles', None)


    class Varint(KaitaiStruct):
        """LEB128 of at most 63 bits (§5.7); that it is as short as possible is not checked here."""
        def __init__(self, _io, _parent=None, _root=None):
            super(Scar.Varint, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self._read()

        def _read(self):
            self.groups = []
            i = 0
            while True:
                _ = self._io.read_u1()
                self.groups.append(_)
                if  ((_ < 128) or (i == 9)) :
                    break
                i += 1


        def _fetch_instances(self):
            pass
            for i in range(len(self.groups)):
                pass


        @property
        def last(self):
            if hasattr(self, '_m_last'):
                return self._m_last

            self._m_last = len(self.groups) - 1
            return getattr(self, '_m_last', None)

        @property
        def signed_value(self):
            """svarint of §5.7."""
            if hasattr(self, '_m_signed_value'):
                return self._m_signed_value

            self._m_signed_value = (self.value >> 1 if self.value & 1 == 0 else -(self.value >> 1) - 1)
            return getattr(self, '_m_signed_value', None)

        @property
        def value(self):
            if hasattr(self, '_m_value'):
                return self._m_value

            self._m_value = (((((((self.groups[0] & 127 | ((self.groups[1] & 127) << 7 if self.last >= 1 else 0)) | ((self.groups[2] & 127) << 14 if self.last >= 2 else 0)) | ((self.groups[3] & 127) << 21 if self.last >= 3 else 0)) | ((self.groups[4] & 127) << 28 if self.last >= 4 else 0)) | ((self.groups[5] & 127) << 35 if self.last >= 5 else 0)) | ((self.groups[6] & 127) << 42 if self.last >= 6 else 0)) | ((self.groups[7] & 127) << 49 if self.last >= 7 else 0)) | ((self.groups[8] & 127) << 56 if self.last >= 8 else 0)
            return getattr(self, '_m_value', None)


    @property
    def first_layer_block(self):
        """The LAYER block of layer 1, the first of every conforming file, which has the channel table."""
        if hasattr(self, '_m_first_layer_block'):
            return self._m_first_layer_block

        self._m_first_layer_block = self.layers[0].blocks.models[0].body
        return getattr(self, '_m_first_layer_block', None)

    @property
    def page_count(self):
        if hasattr(self, '_m_page_count'):
            return self._m_page_count

        self._m_page_count = ((self.header.tile_count + self.page_size) - 1) // self.page_size
        return getattr(self, '_m_page_count', None)

    @property
    def page_size(self):
        """Tiles of a page; the last may have fewer."""
        if hasattr(self, '_m_page_size'):
            return self._m_page_size

        self._m_page_size = 1 << self.header.page_bits
        return getattr(self, '_m_page_size', None)


