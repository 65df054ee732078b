"""Zstandard frames (RFC 8878) in plain loops, standard library only: what SPEC §5.8 lets a file hold."""

from __future__ import annotations

from typing import NamedTuple

MAGIC = bytes.fromhex("28b52ffd")
MAX_BLOCK = 1 << 17
_LENGTHS = (
    *((n, 0) for n in range(16)), *((16 + 2 * n, 1) for n in range(4)), (24, 2), (28, 2), (32, 3), (40, 3), (48, 4),
    *((1 << n, n) for n in range(6, 17)),
)
_MATCHES = (
    *((n, 0) for n in range(3, 35)), *((35 + 2 * n, 1) for n in range(4)), (43, 2), (47, 2), (51, 3), (59, 3), (67, 4),
    (83, 4), (99, 5), *((3 + (1 << n), n) for n in range(7, 17)),
)
_OFFSETS = tuple((1 << n, n) for n in range(32))
_PREDEFINED = (
    ([4, 3, *[2] * 11, 1, 1, 1, *[2] * 9, 3, 2, *[1] * 5, *[-1] * 4], 6),
    ([*[1] * 6, 2, 2, 2, *[1] * 15, *[-1] * 5], 5),
    ([1, 4, 3, *[2] * 6, *[1] * 37, *[-1] * 7], 6),
)
_CODES, _MOST_LOGS = (_LENGTHS, _OFFSETS, _MATCHES), (9, 8, 9)


class BadFrame(Exception):
    """The bytes are not one whole sound frame."""


class Header(NamedTuple):
    """Content size and window, bytes; where the blocks begin."""

    content: int
    window: int
    start: int


class Fse(NamedTuple):
    """A table of finite state entropy: per state the symbol, the bits to read, and what is added to them."""

    rows: list[tuple[int, int, int]]
    log: int


def _check(holds: bool) -> None:
    if not holds:
        raise BadFrame


class _Bytes:
    """A cursor, and bits from it, least significant first."""

    def __init__(self, data: bytes) -> None:
        self.data, self.at, self.bit = data, 0, 0

    def take(self, size: int) -> bytes:
        _check(0 <= size <= len(self.data) - self.at)
        self.at += size
        return self.data[self.at - size : self.at]

    def number(self, size: int) -> int:
        return int.from_bytes(self.take(size), "little")

    def rest(self) -> bytes:
        return self.take(len(self.data) - self.at)

    def bits(self, count: int) -> int:
        _check(8 * self.at + self.bit + count <= 8 * len(self.data))
        value = int.from_bytes(self.data[self.at : self.at + 4], "little") >> self.bit & ((1 << count) - 1)
        self.bit += count
        self.at, self.bit = self.at + self.bit // 8, self.bit % 8
        return value

    def align(self) -> None:
        self.at, self.bit = self.at + (self.bit > 0), 0


class _Backward:
    """Bits from the end of a stream, which a bit 1 marks; beyond its beginning they are 0, and `left` is negative."""

    def __init__(self, data: bytes) -> None:
        _check(bool(data) and data[-1] > 0)
        self.data = data
        self.left = 8 * len(data) - 9 + data[-1].bit_length()

    def peek(self, count: int) -> int:
        low = self.left - count
        first = max(low, 0)
        part = self.data[first // 8 : max(self.left + 7, 0) // 8]
        value = int.from_bytes(part, "little") >> first % 8
        return (value << first - low) & ((1 << count) - 1)

    def read(self, count: int) -> int:
        value = self.peek(count)
        self.left -= count
        return value


def frame_header(frame: bytes) -> Header:
    """The header of a frame.

    Raises:
        BadFrame: it is not whole, states no content size, or has a dictionary, a checksum or the reserved bit.
    """
    reader = _Bytes(frame)
    _check(reader.take(4) == MAGIC)
    flags = reader.number(1)
    single = flags >> 5 & 1
    place = 0 if single else reader.number(1)
    dictionary = reader.number((0, 1, 2, 4)[flags & 3])
    width = (single, 2, 4, 8)[flags >> 6]
    content = reader.number(width) + (256 if width == 2 else 0)
    _check(not flags & 0b1100 and dictionary == 0 and width > 0 and content > 0)
    base = 1 << 10 + (place >> 3)
    return Header(content, content if single else base + base // 8 * (place & 7), reader.at)


def frame_content(frame: bytes) -> bytes:
    """The content of exactly one frame.

    Raises:
        BadFrame: for bytes that are not one.
    """
    header = frame_header(frame)
    reader = _Bytes(frame)
    reader.at = header.start
    blocks, last = _Blocks(min(header.window, MAX_BLOCK)), False
    while not last:
        head = reader.number(3)
        last, kind, size = bool(head & 1), head >> 1 & 3, head >> 3
        before = len(blocks.content)
        _check(kind < 3 and size <= blocks.most)
        if kind < 2:
            blocks.content += reader.take(size) if kind == 0 else reader.take(1) * size
        else:
            blocks.add(_Bytes(reader.take(size)))
        _check(len(blocks.content) <= header.content and len(blocks.content) - before <= blocks.most)
    _check(reader.at == len(frame) and len(blocks.content) == header.content)
    return bytes(blocks.content)


class _Blocks:
    """The content so far, and what compressed blocks take over from those before."""

    def __init__(self, most: int) -> None:
        self.most = most
        self.content = bytearray()
        self.huffman: list[tuple[int, int]] = []
        self.tables: list[Fse | None] = [None, None, None]
        self.recent = [1, 4, 8]

    def add(self, block: _Bytes) -> None:
        literals, done, out = self._literals(block), 0, self.content
        for length, match, offset in self._sequences(block):
            _check(done + length <= len(literals))
            out += literals[done : done + length]
            done += length
            _check(0 < offset <= len(out))
            for _ in range(match):
                out.append(out[-offset])
        out += literals[done:]

    def _literals(self, block: _Bytes) -> bytes:
        kind, form = block.bits(2), block.bits(2)
        block.at, block.bit = block.at, 4
        if kind < 2:
            block.bit = 3 if form in (0, 2) else 4
            size = block.bits((5, 12, 5, 20)[form])
            _check(size <= self.most)
            return block.take(size) if kind == 0 else block.take(1) * size
        width = (10, 10, 14, 18)[form]
        size, packed = block.bits(width), block.bits(width)
        block.align()
        _check(size <= self.most)
        part = _Bytes(block.take(packed))
        if kind == 2:
            self.huffman = _huffman(part)
        _check(bool(self.huffman))
        if form == 0:
            return self._symbols(part.rest(), size)
        lengths, each = [part.number(2) for _ in range(3)], (size + 3) // 4
        _check(size >= 3 * each)
        streams = [part.take(length) for length in lengths]
        found = [self._symbols(stream, each) for stream in streams]
        return b"".join([*found, self._symbols(part.rest(), size - 3 * each)])

    def _symbols(self, stream: bytes, count: int) -> bytes:
        """Huffman-coded symbols; whether they use up the stream is not checked (R-5.8-4)."""
        bits, log, out = _Backward(stream), len(self.huffman).bit_length() - 1, bytearray()
        for _ in range(count):
            symbol, used = self.huffman[bits.peek(log)]
            bits.left -= used
            out.append(symbol)
        return bytes(out)

    def _sequences(self, block: _Bytes) -> list[tuple[int, int, int]]:
        """Literal length, match length, offset of each sequence."""
        count = block.number(1)
        if count == 0:
            _check(block.at == len(block.data))
            return []
        if count == 255:
            count = block.number(2) + 0x7F00
        elif count > 127:
            count = (count - 128 << 8) + block.number(1)
        modes = block.number(1)
        _check(modes & 3 == 0)
        for which in range(3):
            self.tables[which] = self._table(block, which, modes >> (6 - 2 * which) & 3)
        lengths, offsets, matches = (table for table in self.tables if table is not None)
        bits, out = _Backward(block.rest()), []
        a, b, c = bits.read(lengths.log), bits.read(offsets.log), bits.read(matches.log)
        for number in range(count):
            codes = (lengths.rows[a][0], offsets.rows[b][0], matches.rows[c][0])
            offset, match, length = (_extra(bits, which, codes[which]) for which in (1, 2, 0))
            out.append((length, match, self._offset(offset, length)))
            if number + 1 < count:
                a, c, b = _next(bits, lengths, a), _next(bits, matches, c), _next(bits, offsets, b)
        _check(bits.left == 0)
        return out

    def _table(self, block: _Bytes, which: int, mode: int) -> Fse:
        if mode == 0:
            return _fse(*_PREDEFINED[which])
        if mode == 1:
            code = block.number(1)
            _check(code < len(_CODES[which]))
            return Fse([(code, 0, 0)], 0)
        if mode == 2:
            return _fse(*_distribution(block, _MOST_LOGS[which], len(_CODES[which])))
        found = self.tables[which]
        if found is None:
            raise BadFrame
        return found

    def _offset(self, value: int, length: int) -> int:
        if value > 3:
            self.recent = [value - 3, *self.recent[:2]]
            return value - 3
        place = value - 1 + (length == 0)
        offset = self.recent[place] if place < 3 else self.recent[0] - 1
        _check(offset > 0)
        self.recent.insert(0, offset)
        del self.recent[min(place, 2) + 1]
        return offset


def _extra(bits: _Backward, which: int, code: int) -> int:
    base, extra = _CODES[which][code]
    return base + bits.read(extra)


def _next(bits: _Backward, table: Fse, state: int) -> int:
    _, count, base = table.rows[state]
    return base + bits.read(count)


def _distribution(reader: _Bytes, most_log: int, symbols: int) -> tuple[list[int], int]:
    """Counts of symbols, -1 for less than one, and the logarithm of their sum."""
    log = reader.bits(4) + 5
    _check(log <= most_log)
    left, counts = 1 << log, list[int]()
    while left > 0:
        _check(len(counts) < symbols)
        width = (left + 1).bit_length()
        short = (1 << width) - 2 - left
        value = reader.bits(width - 1)
        if value >= short:
            value |= reader.bits(1) << (width - 1)
            value -= short if value >> (width - 1) else 0
        counts.append(value - 1)
        left -= abs(value - 1)
        more = 3 if value == 1 else 0
        while more == 3:
            more = reader.bits(2)
            counts += [0] * more
    reader.align()
    _check(left == 0 and len(counts) <= symbols)
    return counts, log


def _fse(counts: list[int], log: int) -> Fse:
    size = 1 << log
    rare = [symbol for symbol, count in enumerate(counts) if count == -1]
    symbols = [0] * (size - len(rare)) + rare[::-1]
    at, step, past = 0, (size >> 1) + (size >> 3) + 3, size - len(rare)
    for symbol, count in enumerate(counts):
        for _ in range(max(count, 0)):
            symbols[at] = symbol
            at = (at + step) % size
            while at >= past:
                at = (at + step) % size
    following, rows = [abs(count) for count in counts], []
    for symbol in symbols:
        width = log + 1 - following[symbol].bit_length()
        rows.append((symbol, width, (following[symbol] << width) - size))
        following[symbol] += 1
    return Fse(rows, log)


def _huffman(reader: _Bytes) -> list[tuple[int, int]]:
    """Symbol and length for every number of as many bits as the longest code has."""
    head = reader.number(1)
    if head < 128:
        weights = _weights(_Bytes(reader.take(head)))
    else:
        packed = reader.take((head - 126) // 2)
        weights = [packed[i // 2] >> (0 if i % 2 else 4) & 15 for i in range(head - 127)]
    total = sum(1 << weight >> 1 for weight in weights)
    log = total.bit_length()
    left = (1 << log) - total
    _check(0 < log <= 11 and left & (left - 1) == 0 and len(weights) < 256)
    weights.append(left.bit_length())
    table: list[tuple[int, int]] = []
    for weight in range(1, log + 1):
        for symbol, own in enumerate(weights):
            if own == weight:
                table += [(symbol, log + 1 - weight)] * (1 << weight - 1)
    _check(len(table) == 1 << log)
    return table


def _weights(reader: _Bytes) -> list[int]:
    """Weights of Huffman codes, by two states that take turns."""
    table = _fse(*_distribution(reader, 6, 13))
    bits, out = _Backward(reader.rest()), list[int]()
    states = [bits.read(table.log), bits.read(table.log)]
    _check(bits.left >= 0)
    while bits.left >= 0:
        _check(len(out) < 255)
        turn = len(out) % 2
        out.append(table.rows[states[turn]][0])
        states[turn] = _next(bits, table, states[turn])
    return [*out, table.rows[states[len(out) % 2]][0]]
