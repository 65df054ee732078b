# Made by `make ksy` from scar.ksy, sha256 ef21a708c4e26a5749f881cf88244b8962298aacc2cab20c7e3a9917ad880309
# This is a generated file! Please edit source .ksy file and use kaitai-struct-compiler to rebuild
# type: ignore

import kaitaistruct
from kaitaistruct import KaitaiStruct, KaitaiStream, BytesIO
from enum import IntEnum


if getattr(kaitaistruct, 'API_VERSION', (0, 9)) < (0, 11):
    raise Exception("Incompatible Kaitai Struct Python API: 0.11 or later is required, but you have %s" % (kaitaistruct.__version__))

class Scar(KaitaiStruct):
    """A scene of 3D Gaussians in layers. The header and the directory say where every block lies; blocks are in the order
    in which a reader wants them, layer by layer, so a file cut after a layer is that scene, coarser.
    
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
            self.layers.append(Scar.LayerSummary(self._io, self, self._root))

        self.header_crc32 = self._io.read_u4le()
        self.tiles = []
        for i in range(self.header.tile_count):
            self.tiles.append(Scar.TileRecord(self._io, self, self._root))

        self.entries = []
        for i in range(self.header.entry_count):
            self.entries.append(Scar.DirectoryEntry(self._io, self, self._root))



    def _fetch_instances(self):
        pass
        self.header._fetch_instances()
        for i in range(len(self.layers)):
            pass
            self.layers[i]._fetch_instances()

        for i in range(len(self.tiles)):
            pass
            self.tiles[i]._fetch_instances()

        for i in range(len(self.entries)):
            pass
            self.entries[i]._fetch_instances()


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


    class DirectoryEntry(KaitaiStruct):
        """DIRECTORY_ENTRY (§5.5)."""
        def __init__(self, _io, _parent=None, _root=None):
            super(Scar.DirectoryEntry, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self._read()

        def _read(self):
            self.kind = KaitaiStream.resolve_enum(Scar.BlockKind, self._io.read_u1())
            _ = self.kind
            if not int(self.kind) != 0:
                raise kaitaistruct.ValidationExprError(self.kind, self._io, u"/types/directory_entry/seq/0")
            self.flags = self._io.read_u1()
            if not self.flags <= 2:
                raise kaitaistruct.ValidationGreaterThanError(2, self.flags, self._io, u"/types/directory_entry/seq/1")
            self.layer = self._io.read_u1()
            if not self.layer >= 1:
                raise kaitaistruct.ValidationLessThanError(1, self.layer, self._io, u"/types/directory_entry/seq/2")
            if not self.layer <= self._root.header.layer_count:
                raise kaitaistruct.ValidationGreaterThanError(self._root.header.layer_count, self.layer, self._io, u"/types/directory_entry/seq/2")
            self.reserved = self._io.read_u1()
            if not self.reserved == 0:
                raise kaitaistruct.ValidationNotEqualError(0, self.reserved, self._io, u"/types/directory_entry/seq/3")
            self.tile = self._io.read_u4le()
            _ = self.tile
            if not  ((_ < self._root.header.tile_count) or (_ == 4294967295)) :
                raise kaitaistruct.ValidationExprError(self.tile, self._io, u"/types/directory_entry/seq/4")
            self.offset = self._io.read_u8le()
            self.length = self._io.read_u8le()
            if not self.length >= 1:
                raise kaitaistruct.ValidationLessThanError(1, self.length, self._io, u"/types/directory_entry/seq/6")
            self.count = self._io.read_u4le()
            self.crc32 = self._io.read_u4le()


        def _fetch_instances(self):
            pass
            _ = self.body
            if hasattr(self, '_m_body'):
                pass
                _on = self.kind
                if _on == Scar.BlockKind.hash_grid:
                    pass
                    self._m_body._fetch_instances()
                elif _on == Scar.BlockKind.layer:
                    pass
                    self._m_body._fetch_instances()
                elif _on == Scar.BlockKind.streaming:
                    pass
                    self._m_body._fetch_instances()
                elif _on == Scar.BlockKind.tile:
                    pass
                    self._m_body._fetch_instances()
                else:
                    pass
                    self._m_body._fetch_instances()


        @property
        def body(self):
            if hasattr(self, '_m_body'):
                return self._m_body

            _pos = self._io.pos()
            self._io.seek(self.offset)
            _on = self.kind
            if _on == Scar.BlockKind.hash_grid:
                pass
                self._raw__m_body = self._io.read_bytes(self.length)
                _io__raw__m_body = KaitaiStream(BytesIO(self._raw__m_body))
                self._m_body = Scar.HashGridBlock(_io__raw__m_body, self, self._root)
            elif _on == Scar.BlockKind.layer:
                pass
                self._raw__m_body = self._io.read_bytes(self.length)
                _io__raw__m_body = KaitaiStream(BytesIO(self._raw__m_body))
                self._m_body = Scar.LayerBlock(self.layer, _io__raw__m_body, self, self._root)
            elif _on == Scar.BlockKind.streaming:
                pass
                self._raw__m_body = self._io.read_bytes(self.length)
                _io__raw__m_body = KaitaiStream(BytesIO(self._raw__m_body))
                self._m_body = Scar.StreamingBlock(_io__raw__m_body, self, self._root)
            elif _on == Scar.BlockKind.tile:
                pass
                self._raw__m_body = self._io.read_bytes(self.length)
                _io__raw__m_body = KaitaiStream(BytesIO(self._raw__m_body))
                self._m_body = Scar.TileBlock(_io__raw__m_body, self, self._root)
            else:
                pass
                self._raw__m_body = self._io.read_bytes(self.length)
                _io__raw__m_body = KaitaiStream(BytesIO(self._raw__m_body))
                self._m_body = Scar.RawBlock(_io__raw__m_body, self, self._root)
            self._io.seek(_pos)
            return getattr(self, '_m_body', None)


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
            if not self.minor == 1:
                raise kaitaistruct.ValidationNotEqualError(1, self.minor, self._io, u"/types/file_header/seq/2")
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
            self.reserved = self._io.read_u1()
            if not self.reserved == 0:
                raise kaitaistruct.ValidationNotEqualError(0, self.reserved, self._io, u"/types/file_header/seq/13")
            self.tile_count = self._io.read_u4le()
            if not self.tile_count <= 1048576:
                raise kaitaistruct.ValidationGreaterThanError(1048576, self.tile_count, self._io, u"/types/file_header/seq/14")
            self.entry_count = self._io.read_u4le()
            if not self.entry_count <= 4194304:
                raise kaitaistruct.ValidationGreaterThanError(4194304, self.entry_count, self._io, u"/types/file_header/seq/15")
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
            self.directory_crc32 = self._io.read_u4le()


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


    class LayerSummary(KaitaiStruct):
        """LAYER_SUMMARY (§5.3); counts are cumulative."""
        def __init__(self, _io, _parent=None, _root=None):
            super(Scar.LayerSummary, self).__init__(_io)
            self._parent = _parent
            self._root = _root
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



    class TileRecord(KaitaiStruct):
        """TILE_RECORD (§5.4), a cube of the position lattice."""
        def __init__(self, _io, _parent=None, _root=None):
            super(Scar.TileRecord, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self._read()

        def _read(self):
            self.depth = self._io.read_u1()
            if not self.depth <= 21:
                raise kaitaistruct.ValidationGreaterThanError(21, self.depth, self._io, u"/types/tile_record/seq/0")
            self.shift = self._io.read_u1()
            if not self.shift <= 31:
                raise kaitaistruct.ValidationGreaterThanError(31, self.shift, self._io, u"/types/tile_record/seq/1")
            self.reserved = self._io.read_u2le()
            if not self.reserved == 0:
                raise kaitaistruct.ValidationNotEqualError(0, self.reserved, self._io, u"/types/tile_record/seq/2")
            self.prefix = self._io.read_u8le()


        def _fetch_instances(self):
            pass

        @property
        def local_bits(self):
            """Bits per axis of a position within the tile, 0..21 (R-5.4-6)."""
            if hasattr(self, '_m_local_bits'):
                return self._m_local_bits

            self._m_local_bits = (self._root.header.lattice_bits - self.depth) - self.shift
            return getattr(self, '_m_local_bits', None)


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

        self._m_first_layer_block = self.entries[0].body
        return getattr(self, '_m_first_layer_block', None)


