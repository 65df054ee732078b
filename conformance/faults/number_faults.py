"""Files whose blocks of adaptive numbers break one rule (SPEC §8.2, §8.3, §8.5)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

from conformance.decoders.python.fields import key
from conformance.scenes.cases import Fault
from conformance.surgery.edit import append, renumber
from conformance.surgery.files import change_block, change_numbers, with_tables
from conformance.writer.numbers import Number
from conformance.writer.tables import Record
from scarfmt.container.schema import BlockKind, Stream

_TABLE, _LIMIT, _SEAL = ("R-8.3-1", "bad-table"), ("R-8.5-4", "count-limit"), ("R-8.2-2", "rans-seal")
_NUMBER, _SHIFTED, _MLP = ("R-8.5-1", "bad-number"), ("R-8.5-2", "bad-number"), ("R-7.9-1", "bad-mlp")
_TOP, _LONG = (1 << 31) - 1, (1 << 32) - 1
WORD = bytes([1, 0, 0, 0])
"""Before a stream it makes the state at the end another."""
_UNUSED = key(Stream.FRAMING, 0, 0, 0)
"""A key that names nothing, after all others."""


def number_faults(core: bytes, static: bytes, anchors: bytes, equal: bytes, predicted: bytes) -> Iterator[Fault]:
    """Faults of a core file, of one with CODEBOOKS and DECODER_MLP in layer 1, of one with SCENE_MLP, of one whose
    index network ends in biases of 0, and of one with predictors."""
    shifted = (equal, BlockKind.ENTROPY_NETWORK), (predicted, BlockKind.PREDICTORS)
    for data, kind in (
        (core, BlockKind.LAYER), (core, BlockKind.TABLES), (static, BlockKind.CODEBOOKS),
        (static, BlockKind.DECODER_MLP), (anchors, BlockKind.SCENE_MLP), *shifted,
    ):
        name = kind.name.lower().replace("_", "-")
        yield (f"{name}-odd", "a byte after the last word", "R-8.2-1", "rans-length",
               change_block(data, kind, 1, append()))
        yield (f"{name}-last-word", "a last word of 0", "R-8.2-1", "rans-last-word",
               change_block(data, kind, 1, append(bytes(4))))
        yield (f"{name}-word-more", "a word more than the numbers take", *_SEAL,
               change_block(data, kind, 1, lambda payload: WORD + payload))
        yield (f"{name}-word-less", "the first word is missing: the reader goes on, the end is wrong", *_SEAL,
               change_block(data, kind, 1, lambda payload: payload[4:]))
        yield (f"{name}-number-more", "a number after the last", *_SEAL,
               change_numbers(data, kind, lambda numbers: [*numbers, (("more", 0), 1)]))
        yield (f"{name}-number-long", "a number that begins with 32 bits of 1", *_NUMBER,
               change_numbers(data, kind, ending_long))
    for data, kind in shifted:
        name = kind.name.lower().replace("_", "-")
        for which, what, rule, shift, first in (
            ("32", "numbers shifted by 32", _LIMIT, 32, 0), ("wide", "1 shifted by 31", _SHIFTED, 31, 2),
            ("low", "-1 shifted by 31: -2^31, which 32 bits hold", _SHIFTED, 31, 1),
        ):
            yield (f"{name}-shift-{which}", what, *rule,
                   change_numbers(data, kind, partial(_shift, shift=shift, first=first)))
    mlp, books, order = BlockKind.DECODER_MLP, BlockKind.CODEBOOKS, ("R-8.5-1 R-12.2-3", "bad-number")
    for name, purpose, rule, kind, changes in (
        ("mlp-order-weights", "a weight of 32768, then a long one", order, mlp,
         (("weights", 1 << 16), ("weights", _LONG))),
        ("mlp-order-scales", "a weight of 32768, then a long scale", _MLP, mlp,
         (("weights", 1 << 16), ("scales", _LONG))),
        ("mlp-order-biases", "a scale that is not a number, then a long bias", _MLP, mlp,
         (("scales", 0x7FC00000), ("biases", _LONG))),
        ("book-order", "a component of 65536, then a long one of the same dimension", order, books,
         (("words", 1 << 17), ("words", _LONG))),
    ):  # fmt: skip
        yield name, purpose, *rule, change_numbers(static, kind, renumber(*changes))


def ending_long(numbers: list[Number]) -> list[Number]:
    """The numbers, the last of them too long."""
    return [*numbers[:-1], (numbers[-1][0], _LONG)]


def _shift(numbers: list[Number], shift: int, first: int) -> list[Number]:
    """The numbers, of the last array that is shifted another shift and first number."""
    at = max(i for i, (field, _) in enumerate(numbers) if field[0] == "shift of")
    return [*numbers[:at], (numbers[at][0], shift), (numbers[at + 1][0], first), *numbers[at + 2 :]]


def _high_digit(numbers: list[Number], digit: int) -> list[Number]:
    """The numbers, 256 for a digit of each key that follows another digit than that of the key before."""
    return [(name, 256 if name == ("key", digit, 0) else number) for name, number in numbers]


def table_faults(core: bytes) -> Iterator[Fault]:
    """Faults of tables; most add one at the end that codes nothing."""

    def last(*values: int, weights: tuple[int, ...] = (1, 1)) -> bytes:
        return with_tables(core, 1, lambda records: [*records, Record(_UNUSED, values, weights)])

    def numbers(change: Callable[[list[Number]], list[Number]]) -> bytes:
        return change_numbers(core, BlockKind.TABLES, change)

    yield "key-digit-256", "a stream kind of 256", *_TABLE, with_tables(
        core, 1, lambda records: [*records, Record(256 << 24, (0,), (1,))])
    for digit, what in enumerate(("component", "step", "context"), start=1):
        yield f"key-digit-{digit}-256", f"a {what} of 256", *_TABLE, numbers(partial(_high_digit, digit=digit))
    most = with_tables(core, 1, lambda records: [*records, Record((1 << 32) - 1, (0,), (1,))])
    # The numbers of its key are 0 and cost nothing.
    yield ("key-after-last", "a key after that of four digits of 255", *_TABLE,
           change_numbers(most, BlockKind.TABLES, lambda n: [(n[0][0], n[0][1] + 1), *n[1:]]))
    yield "alphabet-last-high", "an alphabet up to 2^31", *_TABLE, last(0, _TOP + 1)
    yield "alphabet-wide-gap", "the widest gap, to far above 2^31", *_TABLE, last(0, _LONG)
    yield "alphabet-gap-long", "a gap that leaves 2^31 - 1, then a number that is too long", *_NUMBER, last(
        0, _LONG, 2 * _LONG + 1, weights=(1, 1, 1))
    yield ("alphabet-weight-long", "an alphabet that leaves 2^31 - 1, then a weight that is too long", *_TABLE,
           last(0, _TOP + 1, weights=(1, _LONG + 1)))
    yield "weight-25-bits", "a weight of 2^24", *_TABLE, last(0, 1, weights=(1 << 24, 1))
    yield ("weight-number-long", "a weight of 2^24, then one that is too long", *_NUMBER,
           last(0, 1, weights=(1 << 24, _LONG + 1)))
    yield "precision-24", "weights of 25 bits, as the table says", *_LIMIT, numbers(
        lambda n: [(field, 24 if field[0] == "precision" else value) for field, value in n])
    yield "table-4097", "a table of 4097 symbols", *_LIMIT, last(*range(4097), weights=(1,) * 4097)
    yield "tables-65537", "65537 tables", *_LIMIT, numbers(lambda n: [(n[0][0], 65537), *n[1:]])
