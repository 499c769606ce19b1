"""Binary frames described as data, and the decoder that finds them in a stream of bytes.

A frame begins with sync bytes, says how long it is or is always as long, and ends with a checksum.
Its payload holds fields at fixed places, or items that say their identifier and size. What arrives
may be torn anywhere, may have bytes of others between frames, and may lack frames: the decoder
looks for the next sync byte by byte, believes a frame by its checksum, and counts what it left out.
"""

from __future__ import annotations

import binascii
import re
import struct
import tomllib
import zlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, ValidationError, model_validator

from foucault.arrays import FloatArray, IntArray
from foucault.errors import error
from foucault.strict import Strict

Type = Literal["u8", "i8", "u16", "i16", "u32", "i32", "u64", "i64", "f32", "f64"]
CODE = dict(zip(("u8", "i8", "u16", "i16", "u32", "i32", "u64", "i64", "f32", "f64"),
                "BbHhIiQqfd", strict=True))  # fmt: skip
SIZE = {name: struct.calcsize("<" + code) for name, code in CODE.items()}
"""Bytes of each type [1]."""

LONGEST = 4096
"""Longest frame that is waited for; a length beyond it is taken for junk [bytes]."""


BESIDES = frozenset(("time", "counter", "serial"))
"""Fields that are no readings."""

GAP = 20_000
"""More frames than these are not made up for: the counter began anew [1]."""


def _bytes(given: Any) -> Any:
    """Take bytes in hexadecimal, such as "FA FF"."""
    try:
        return bytes.fromhex(given) if isinstance(given, str) else given
    except ValueError:
        raise ValueError(
            f'bytes in hexadecimal are wanted, such as "FA FF", not "{given}"'
        ) from None


Bytes = Annotated[bytes, BeforeValidator(_bytes)]


def _each(given: Any) -> Any:
    return given if isinstance(given, (list, tuple)) else (given,)


class Match(Strict):
    """Bytes that tell the frames that are wanted from others of the same sync."""

    at: int = Field(ge=0)
    bytes: Annotated[tuple[Bytes, ...], BeforeValidator(_each)]


class Length(Strict):
    """Where a frame says how long it is."""

    at: int = Field(ge=0)
    type: Type = "u8"
    add: int = 0  # what the whole frame is longer than that [bytes]
    below: int = LONGEST  # values from here on mean something else, and the frame is not read [1]


class Checksum(Strict):
    """What is computed of which bytes of a frame, and where it stands."""

    kind: Literal["sum8", "sum16", "xor8", "fletcher16", "crc16", "crc32"]
    first: int = 0  # from this byte on
    last: int  # up to this byte, counted from the end where negative
    at: int
    order: Literal["little", "big"] | None = None  # of its bytes, None: of the frame
    poly: int = 0
    init: int = 0
    final: int = 0  # with which it is combined by exclusive or at the end
    reflected: bool = False
    negated: bool = False  # whether the sum of all bytes and of itself is nothing
    extra: Bytes = b""  # that are summed up after them, though they are not sent

    @cached_property
    def size(self) -> int:
        """Its length [bytes]."""
        return {"sum8": 1, "xor8": 1, "crc32": 4}.get(self.kind, 2)

    def function(self) -> Callable[[bytes], int]:
        """Return what computes it, the quickest there is."""
        if (self.kind, self.poly, self.reflected) == ("crc16", 0x1021, True):
            init, final, of = _turned(self.init), self.final, binascii.crc_hqx
            return lambda data: TURNED_WORDS[of(data.translate(TURNED), init)] ^ final
        return self.of

    def of(self, data: bytes) -> int:
        """Compute it."""
        bits = 8 * self.size
        if self.kind == "xor8":
            out = 0
            for byte in data:
                out ^= byte
            return out
        if self.kind in ("sum8", "sum16"):
            total = sum(data)
            return (-total if self.negated else total) & ((1 << bits) - 1)
        if self.kind == "fletcher16":
            a = b = 0
            for byte in data:
                a = (a + byte) % 255
                b = (b + a) % 255
            return b << 8 | a
        if (self.kind, self.poly, self.reflected) == ("crc32", 0x04C11DB7, True):
            return (zlib.crc32(data, self.init ^ 0xFFFFFFFF) ^ 0xFFFFFFFF) ^ self.final
        return crc(data, bits, self.poly, self.init, self.reflected) ^ self.final


def crc(data: bytes, bits: int, poly: int, init: int = 0, reflected: bool = False) -> int:
    """Return the cyclic redundancy check of `data`, without a final exclusive or.

    `bits`: its length [1]; `poly`, `init`: polynomial and start, most significant bit first [1].
    """
    if (bits, poly) == (16, 0x1021):  # a register that shifts right is one that shifts left, turned
        if not reflected:
            return binascii.crc_hqx(data, init)
        return _turned(binascii.crc_hqx(data.translate(TURNED), _turned(init)))
    table, out, mask = _table(bits, poly, reflected), init, (1 << bits) - 1
    if reflected:
        for byte in data:
            out = (out >> 8) ^ table[(out ^ byte) & 0xFF]
        return out
    for byte in data:
        out = ((out << 8) & mask) ^ table[(out >> (bits - 8)) ^ byte]
    return out


TURNED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))
"""Bytes with their bits in the other order."""


def _turned(word: int) -> int:
    return TURNED[word & 255] << 8 | TURNED[word >> 8]


TURNED_WORDS = tuple(map(_turned, range(1 << 16)))
"""Words of 16 bits with their bits in the other order."""


@lru_cache(8)
def _table(bits: int, poly: int, reflected: bool) -> tuple[int, ...]:
    mask, out = (1 << bits) - 1, []
    turned = int(f"{poly:0{bits}b}"[::-1], 2)
    for byte in range(256):
        if reflected:
            value = byte
            for _ in range(8):
                value = value >> 1 ^ (turned if value & 1 else 0)
        else:
            value = byte << (bits - 8)
            for _ in range(8):
                value = (value << 1 ^ (poly if value >> (bits - 1) else 0)) & mask
        out.append(value)
    return tuple(out)


class Bit(Strict):
    """A bit of another field that says that this one is scaled otherwise."""

    of: str
    number: int = Field(ge=0, lt=64)
    divide: float


class Line(Strict):
    """How lines of text look: `at` of the fields counts their cells from 0."""

    prefix: str = ""  # of the lines that are wanted; it is no cell where a separator follows it
    separator: str = ","  # "" for spaces of any number
    # exclusive or of what stands between the first letter and the star, in hexadecimal after it
    checksum: bool = False


class FrameField(Strict):
    """Numbers of a frame: `count` of one type one after the other."""

    name: str
    at: int | None = Field(None, ge=0)
    item: Annotated[tuple[int, ...], BeforeValidator(_each)] = ()
    type: Type = "f64"  # of text: whole numbers that wrap say how wide they are
    count: int = Field(1, ge=1, le=16)
    multiply: float = 1.0
    divide: float = 1.0
    add: float = 0.0  # after that
    unit: str = ""
    bit: Bit | None = None
    axes: tuple[str, str, str] | None = None  # of a triad, where they are not those of the frame


class Items(Strict):
    """A payload of items, each with an identifier and a size before it."""

    at: int = Field(ge=0)
    last: int  # where they end, counted from the end of the frame where negative
    id: Type
    size: Type


class Frame(Strict):
    """How the frames of an instrument look; offsets in bytes from the start of the frame."""

    words: str
    source: str
    order: Literal["little", "big"] = "little"
    sync: Bytes = b""
    match: Match | None = None
    length: Length | Annotated[int, Field(ge=2, le=LONGEST)] | None = None
    line: Line | None = None  # text instead of bytes
    checksum: Checksum | None = None
    kind: Literal["rate", "increment"] = "rate"
    items: Items | None = None
    trimmed: int = 0  # length without the checksum, where zeros at the end are left out [bytes]
    axes: tuple[str, str, str] = ("x", "y", "z")  # which are right, forward and up, such as "-z"
    fields: tuple[FrameField, ...]

    @model_validator(mode="after")
    def _whole(self) -> Frame:
        if (self.line is None) == (self.length is None):
            raise ValueError("frames need `length`, lines of text `line`")
        if (
            self.line is None
            and not self.sync
            and (self.checksum is None or isinstance(self.length, Length))
        ):
            raise ValueError("without sync bytes frames need one length and a checksum")
        for one in self.fields:
            if (one.at is None) == (self.items is None):
                raise ValueError(
                    f"field {one.name} needs `item` where there are `items`, else `at`"
                )
        names = [one.name for one in self.fields]
        if not set(names) - BESIDES:
            raise ValueError(
                "neither accel nor gyro is among the fields, nor another reading, as of a "
                "temperature or the angles of a table"
            )
        return self

    @cached_property
    def imu(self) -> bool:
        """Whether it is of an IMU, or of something beside one."""
        return bool({"accel", "gyro"} & {one.name for one in self.fields})

    @cached_property
    def columns(self) -> tuple[str, ...]:
        """Names of the numbers of a row: of triads x, y and z."""
        out = dict[str, None]()
        for one in self.fields:
            axes = "xyz" if one.count == 3 else map(str, range(one.count))
            out |= dict.fromkeys(
                [one.name] if one.count == 1 else [f"{one.name}_{a}" for a in axes]
            )
        return tuple(out)

    def field_of(self, name: str) -> FrameField | None:
        """Return the first field of a name."""
        return next((one for one in self.fields if one.name == name), None)


def shipped() -> dict[str, str]:
    """Return the descriptions that come with the program: name -> what they are of."""
    folder = resources.files("foucault.capture") / "frames"
    found = sorted(file.name for file in folder.iterdir() if file.name.endswith(".toml"))
    return {
        name.removesuffix(".toml"): tomllib.loads((folder / name).read_text())["words"]
        for name in found
    }


def text_of(name: str) -> str:
    """Return a description as it was written: one that comes with the program, or a file."""
    if name in shipped():
        return (resources.files("foucault.capture") / "frames" / f"{name}.toml").read_text()
    if Path(name).is_file():
        return Path(name).read_text()
    raise error("capture.unknown", name=name, allowed=", ".join(shipped()))


def parsed(text: str, name: str) -> Frame:
    """Return the description that `text` holds; `name`: for messages."""
    try:
        return Frame.model_validate(tomllib.loads(text))
    except tomllib.TOMLDecodeError as problem:
        raise error("capture.description", name=name, reason=str(problem)) from None
    except ValidationError as problem:
        first = problem.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        reason = f"{where + ': ' if where else ''}{first['msg'].removeprefix('Value error, ')}"
        raise error("capture.description", name=name, reason=reason) from None


@dataclass
class Heard:
    """What a stream held beside the rows."""

    frames: int = 0  # that were read [1]
    others: int = 0  # whole ones of other messages [1]
    broken: int = 0  # whose checksum was wrong [1]
    junk: int = 0  # bytes that belong to no frame [bytes]
    lost: int = 0  # frames that a counter says were sent [1]
    reopened: int = 0  # times that the source was lost and opened again [1]


@dataclass
class Decoder:
    """Frames out of bytes as they come."""

    frame: Frame
    heard: Heard = field(default_factory=Heard)
    # Of the rows that came last: up to which byte of all each was heard, shape (n,) [bytes].
    ended: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    begun: int = 0  # before this byte of all nothing can be of a row any more [bytes]
    _held: bytearray = field(default_factory=bytearray)
    # Counter -> what it said last, and without wraps [1].
    _before: dict[str, tuple[int, float]] = field(default_factory=dict)
    _synced: bool = False
    _gap: int = 0  # frames that were lost before the one that is read [1]
    _layouts: dict[int, Any] = field(default_factory=dict)  # length -> how fields lie [bytes]

    def feed(self, data: bytes) -> list[tuple[float, ...]]:
        """Take bytes that have arrived, and return the rows of all frames that are whole now."""
        return [tuple(row) for row in self.rows(data).tolist()]

    def rows(self, data: bytes) -> FloatArray:
        """Take bytes; return rows of whole frames, shape (n, columns) [units of the frame]."""
        self._held += data
        raws, ended = self._raws()
        self.ended = np.array(ended, np.int64)
        if len(raws) > 1 and self._fixed and len({*map(len, raws)}) == 1:
            layout = self._layout(len(raws[0]))
            if layout is not None:
                self.heard.frames += len(raws)
                return self._block(np.frombuffer(b"".join(raws), layout))
        return self._each((self._row(raw) for raw in raws), ended)

    def _each(self, rows: Iterable[tuple[float, ...] | None], ended: list[int]) -> FloatArray:
        """Return rows one by one, without those that are None, with what is missing before them."""
        out, ends = list[tuple[float, ...]](), list[int]()
        for row, end in zip(rows, ended, strict=True):
            if row is None:
                self.heard.others += self.frame.line is None
            else:
                out += [*self._missing(len(row)), row]
                ends += [end] * (len(out) - len(ends))
                self.heard.frames += 1
        self.ended = np.array(ends, np.int64)
        return np.array(out, float).reshape(len(out), len(self.frame.columns))

    @cached_property
    def _fixed(self) -> bool:
        """Whether every frame holds the same fields at the same places."""
        names = [one.name for one in self.frame.fields]
        return not self.frame.items and not self.frame.trimmed and len(names) == len({*names})

    def _layout(self, size: int) -> Any:
        """Return how frames of a length are laid out, None where they lack a field [bytes]."""
        if size not in self._layouts:
            sign, fields = "<" if self.frame.order == "little" else ">", self.frame.fields
            ends = [(one.at or 0) + SIZE[one.type] * one.count for one in fields]
            kinds = [f"{sign}{one.type[0]}{SIZE[one.type]}" for one in fields]
            said: Any = {
                "names": [one.name for one in fields],
                "formats": [(kind, (f.count,)) for kind, f in zip(kinds, fields, strict=True)],
                "offsets": [one.at for one in fields], "itemsize": size,
            }  # fmt: skip
            self._layouts[size] = np.dtype(said) if max(ends) <= size else None
        return self._layouts[size]

    def _block(self, raws: Any) -> FloatArray:
        """Return the rows of frames one after the other, as `_numbers` has them of each."""
        out = np.empty((len(raws), len(self.frame.columns)))
        gaps, at = np.zeros(len(raws), np.int64), 0
        for one, name, counts, bit, multiply, add in self._scales:
            x = raws[name]
            if counts and not one.type.startswith("f"):
                x = self._unwrapped_all(one, x[:, 0], gaps)[:, None]
            divide: Any = one.divide
            if bit is not None:
                divide = np.where(raws[bit.of] >> bit.number & 1, bit.divide, divide)
            scaled = x / divide if multiply == 1.0 and add == 0.0 else multiply * x / divide + add
            out[:, at : at + one.count] = scaled
            at += one.count
        gaps[gaps > GAP] = 0
        if not gaps.any() or self.frame.field_of("time") is not None:
            return out
        whole = np.full((len(out) + int(gaps.sum()), out.shape[1]), np.nan)
        whole[np.arange(len(out)) + np.cumsum(gaps)] = out
        self.ended = np.repeat(self.ended, gaps + 1)
        return whole

    def _unwrapped_all(self, one: FrameField, x: Any, gaps: Any) -> FloatArray:
        """Return counters `x` (n,) as `_unwrapped` does of each, and what is missing in `gaps`."""
        words = np.ascontiguousarray(x).astype(
            f"u{SIZE[one.type]}"
        )  # differences wrap by themselves
        first = int(words[0]) if x.dtype.kind == "u" else int(x[0])
        last, total = self._before.get(one.name, (first, float(first)))
        step = np.diff(words, prepend=np.array([last % (1 << 8 * SIZE[one.type])], words.dtype))
        step[step >= 1 << (8 * SIZE[one.type] - 1)] = 0  # it began anew
        step = step.astype(np.int64)
        if one.name == "counter":
            gaps += np.maximum(step - 1, 0)
            self.heard.lost += int(np.maximum(step - 1, 0).sum())
        every = total + np.cumsum(step)
        self._before[one.name] = int(x[-1]), float(every[-1])
        return np.asarray(every)

    @cached_property
    def _head(self) -> int:
        """How much of a frame says how long it is, and whether it is wanted [bytes]."""
        said, match = self.frame.length, self.frame.match
        long = said.at + SIZE[said.type] if isinstance(said, Length) else 0
        told = [match.at + len(b) for b in match.bytes] if match is not None else []
        return max(len(self.frame.sync), long, *told)

    def _raws(self) -> tuple[list[bytes], list[int]]:
        """Return the frames that are whole, right and wanted, and up to which byte each was."""
        held, sync, at, right_ = self._held, self.frame.sync, 0, self._right
        out, ended = list[bytes](), list[int]()
        while True:
            found = held.find(sync, at) if sync else at
            if found < 0:  # all but what may be the beginning of a sync
                found = max(at, len(held) - len(sync) + 1)
                self.heard.junk += found - at
                at = found
                break
            self.heard.junk += found - at
            at = found
            length = self._length(at)
            if length is None or (length > 0 and len(held) < at + length):
                break
            raw = bytes(held[at : at + length]) if length > 0 else b""
            right = bool(raw) and right_(raw)
            if (
                right and not sync and not self._synced
            ):  # sums of few bytes fit by chance: two do not
                if len(held) < at + 2 * length:
                    break
                right = any(raw) and right_(bytes(held[at + length : at + 2 * length]))
            if not right and raw and self._other(raw):
                end = at + len(raw)
                if len(held) < end + len(sync):
                    break
                if held[end : end + len(sync)] == sync:
                    self.heard.others += 1
                    at = end
                    continue
            if not right:
                self.heard.broken += bool(raw) and (bool(sync) or self._synced)
                self._synced = False
                self.heard.junk += 1
                at += 1
                continue
            self._synced = True
            at += length
            if not self._wanted(raw):
                self.heard.others += 1
                continue
            head = raw[: self._head]
            while True:  # most of those that follow begin alike
                out.append(raw)
                ended.append(self.begun + at)
                raw = bytes(held[at : at + length])
                if len(raw) < length or not raw.startswith(head) or not right_(raw):
                    break
                at += length
        del held[:at]
        self.begun += at
        return out, ended

    def _missing(self, columns: int) -> Iterator[tuple[float, ...]]:
        """Yield rows of nothing for frames that were lost, where only their number is a clock."""
        count, self._gap = self._gap, 0
        if 0 < count <= GAP and self.frame.field_of("time") is None:
            yield from [(float("nan"),) * columns] * count

    def _length(self, at: int) -> int | None:
        """Return the length of the frame at `at`, 0 where it cannot be, None: not yet known."""
        said = self.frame.length
        assert said is not None
        if isinstance(said, int):
            return said
        end = at + said.at + SIZE[said.type]
        if len(self._held) < end:
            return None
        value = int.from_bytes(self._held[at + said.at : end], self.frame.order)
        length = value + said.add
        return length if value < said.below and length <= LONGEST else 0

    @cached_property
    def _right(self) -> Callable[[bytes], bool]:
        """What tells whether a frame is as it was sent."""
        told, order = self.frame.checksum, self.frame.order
        if told is None:
            return lambda _raw: True
        check, order = told.function(), told.order or order
        size, at, first, last, extra = told.size, told.at, told.first, told.last, told.extra
        least = size + len(self.frame.sync)

        def right(raw: bytes) -> bool:
            if len(raw) < least:
                return False
            start = at % len(raw)
            read = int.from_bytes(raw[start : start + size], order)
            return check(raw[first : last % len(raw)] + extra) == read

        return right

    def _other(self, raw: bytes) -> bool:
        """Tell whether it may be another message, whose checksum nobody here can know."""
        told = self.frame.checksum
        return told is not None and bool(told.extra) and not self._wanted(raw)

    def _wanted(self, raw: bytes) -> bool:
        match = self.frame.match
        return match is None or any(raw.startswith(b, match.at) for b in match.bytes)

    @cached_property
    def _readers(self) -> list[tuple[FrameField, Callable[..., tuple[Any, ...]], int]]:
        sign = "<" if self.frame.order == "little" else ">"
        out = []
        for one in self.frame.fields:
            layout = struct.Struct(f"{sign}{one.count}{CODE[one.type]}")
            out.append((one, layout.unpack_from, layout.size))
        return out

    def _row(self, raw: bytes) -> tuple[float, ...] | None:
        """Return the numbers of a frame, None where it lacks one that is always wanted."""
        places = self._items(raw) if self.frame.items else None
        if self.frame.trimmed and self.frame.checksum is not None:
            raw = raw[: self.frame.checksum.last].ljust(self.frame.trimmed, b"\0")
        values: dict[str, tuple[Any, ...]] = {}
        for one, read, size in self._readers:
            at = one.at
            if places is not None:
                held = next((places[i] for i in one.item if i in places), None)
                if held is None or held[1] != size:
                    continue
                at = held[0]
            if at is None or at + size > len(raw):
                continue
            values[one.name] = read(raw, at)
        return self._numbers(values)

    def _numbers(self, values: dict[str, tuple[Any, ...]]) -> tuple[float, ...] | None:
        """Return the row of the values of a frame, scaled; None where it lacks what is wanted."""
        if not self._needed & values.keys():
            return None
        out: list[float] = []
        for one, name, counts, bit, multiply, add in self._scales:
            got = values.get(name)
            if got is None:
                out += [float("nan")] * one.count
                continue
            if counts:
                got = (self._unwrapped(one, got[0]),)
            divide = one.divide
            if bit is not None and bit.of in values:
                divide = bit.divide if values[bit.of][0] >> bit.number & 1 else divide
            if multiply == 1.0 and add == 0.0:
                out += [x / divide for x in got]
            else:
                out += [multiply * x / divide + add for x in got]
        return tuple(out)

    @cached_property
    def _needed(self) -> set[str]:
        """Fields of which a frame has to have one."""
        names = {one.name for one in self.frame.fields}
        return {"accel", "gyro"} & names or names - BESIDES

    @cached_property
    def _scales(self) -> list[tuple[FrameField, str, bool, Bit | None, float, float]]:
        """Of each name the first field: it, its name, whether it counts, its bit, and scales."""
        first = {one.name: one for one in reversed(self.frame.fields)}
        named = {one.name: first[one.name] for one in self.frame.fields}
        return [
            (one, name, name in ("time", "counter"), one.bit, one.multiply, one.add)
            for name, one in named.items()
        ]

    def _items(self, raw: bytes) -> dict[int, tuple[int, int]]:
        """Return where the items of a frame stand, and their sizes: identifier -> both [bytes]."""
        told = self.frame.items
        assert told is not None
        at, end, order, out = told.at, told.last % len(raw), self.frame.order, {}
        head = SIZE[told.id] + SIZE[told.size]
        while at + head <= end:
            name = int.from_bytes(raw[at : at + SIZE[told.id]], order)
            size = int.from_bytes(raw[at + SIZE[told.id] : at + head], order)
            out[name] = at + head, size
            at += head + size
        return out

    def _unwrapped(self, one: FrameField, value: float) -> float:
        """Return a counter that does not wrap, and count what is missing of a frame counter."""
        if one.type.startswith("f"):
            return value
        whole = 1 << 8 * SIZE[one.type]
        last, total = self._before.get(one.name, (int(value), float(value)))
        step = (int(value) - last) % whole
        if step >= whole // 2:  # it began anew
            step = 0
        if one.name == "counter" and step > 1:
            self.heard.lost += step - 1
            self._gap = step - 1
        total += step
        self._before[one.name] = int(value), total
        return total


NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?$")
"""A number at the end of a cell: what stands before it names it."""


class Lines(Decoder):
    """Lines of text as they come; a cell may say what it is before its number."""

    def rows(self, data: bytes) -> FloatArray:
        """Take bytes; return rows of whole lines, shape (n, columns) [units of the frame]."""
        *lines, rest = (self._held + data).replace(b"\r", b"\n").split(b"\n")
        ended = self.begun + np.cumsum([len(line) + 1 for line in lines], dtype=np.int64)
        self._held = bytearray(rest[-LONGEST:])
        self.begun += len(rest) - len(self._held) + sum(len(line) + 1 for line in lines)
        full = [(line[-LONGEST:], end) for line, end in zip(lines, ended.tolist(), strict=True)
                if line]  # fmt: skip
        return self._each((self._read(bytes(line)) for line, _ in full), [end for _, end in full])

    def _read(self, line: bytes) -> tuple[float, ...] | None:
        told, first = self.frame.line, not self._synced
        assert told is not None
        self._synced = True  # the first line may have begun before it was heard
        try:
            text = line.decode("ascii").strip()
        except UnicodeDecodeError:
            self.heard.junk += len(line)
            return None
        if not text.startswith(told.prefix):
            self.heard.others += not first
            self.heard.junk += len(line) * first
            return None
        if told.checksum:
            text, star, said = text.rpartition("*")
            if (
                not star
                or said.upper()
                != f"{Checksum(kind='xor8', last=0, at=0).of(text[1:].encode()):02X}"
            ):
                self.heard.broken += 1
                return None
        inner = text[len(told.prefix) :].removeprefix(told.separator)
        cells = [NUMBER.search(c.strip()) for c in inner.split(told.separator or None)]
        values: dict[str, tuple[Any, ...]] = {}
        for one in self.frame.fields:
            some = cells[one.at : (one.at or 0) + one.count]
            if len(some) == one.count and all(some):
                values[one.name] = tuple(float(c.group()) for c in some if c)
        row = self._numbers(values) if len(values) == len(self.frame.fields) else None
        if row is None:
            self.heard.broken += not first
            self.heard.junk += len(line) * first
        return row


def decoder_of(frame: Frame, heard: Heard) -> Decoder:
    """Return what finds the frames of a description: bytes, or lines of text."""
    return (Decoder if frame.line is None else Lines)(frame, heard)
