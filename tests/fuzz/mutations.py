"""What a fuzzer does to a valid input: bytes, words, YAML values and PNG chunks become odd ones."""

import random
import re
import struct
import zlib
from collections.abc import Sequence
from typing import Any, TypeVar

import yaml

T = TypeVar("T")
NUMBERS = (
    *("0", "-0.0", "-1", "1", "2", "3.5", "0.1", "1e-320", "1e5", "1e9", "1e300", "1e308", "-1e308"),
    *("1e400", "nan", "inf", "-inf", ".nan", "-.inf", "0x10", "0b_", "1_000", "1:30", "255", "65536"),
    *("1000000", "2147483648", "9223372036854775808", "18446744073709551616", "\u0663", "\xb2", "9" * 400),
    "9" * 5000,
)
TEXTS = (
    *("", " ", "{a: 1}", "[" * 200, "&a a", "x" * 300, "x" * 5000, "a\nb", "a\tb", "\u00e9" * 300),
    *("\u202eabc", "\ufeff", "\x1b[31m", "!!python/name:os.system", "os:getcwd", "json:dumps"),
    *("nothing.py:X", "~", "null", "true", "no", "NaN", "None", "{}", "[]", "[[]]", "*a", "-", "--"),
    *("--help", "-1", "=", ":", ",", "1,,2", "%s", "{0}", "$HOME", "`id`", "2020-13-45", "<<"),
    *("../../outside", "/", "/nowhere/at/all", "/dev/null", "/dev/zero", ".", "..", "a/b", "map1", "map2"),
    *("empty", "exact", "explored", "detection", "labyrinth", "mapping", "fast", "bullet"),
)
"""no NUL, which no command line and no file name can have; ``file_bytes`` puts it into files"""
_WORD = re.compile(rb"[^\s,:\[\]{}=]+")
_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")


def pick(rng: random.Random | None, choices: Sequence[T]) -> T:
    """One of them, the first without a generator."""
    return choices[0] if rng is None else rng.choice(choices)


def chance(rng: random.Random | None, share: float) -> bool:
    """Whether to do what is done in that share of the cases; never without a generator."""
    return rng is not None and rng.random() < share


def scalar(rng: random.Random) -> str:
    """A number or a text that somebody might give."""
    return rng.choice(NUMBERS if rng.random() < 0.5 else TEXTS)


def near(number: float, rng: random.Random) -> float:
    """Another number, of the kind and about the size that a reader may take."""
    if isinstance(number, bool):
        return not number
    if isinstance(number, int) and rng.random() < 0.7:
        return rng.choice((number + 1, number - 1, number + 7, 2 * number, -number, 0, number // 2))
    return number * rng.choice((-1.0, 0.0, 0.01, 0.5, 0.9, 0.999, 1.001, 1.1, 2.0, 10.0, 100.0)) + rng.choice(
        (0.0, 0.0, 0.0, 1e-9, 0.05, -0.05, 1.0)
    )


def file_bytes(data: bytes, rng: random.Random) -> bytes:
    """``data`` with one to three places flipped, cut out, repeated, moved or written over."""
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        start = rng.randrange(len(data) + 1)
        end = min(len(data), start + rng.choice((1, 1, 4, 16, 100, 1000)))
        part = data[start:end]
        flipped = bytes(byte ^ 1 << rng.randrange(8) for byte in part)
        data = rng.choice(
            (
                *([data[:start] + flipped + data[end:]] * 4),
                data[:start] + data[end:],
                data[:start] + part * rng.choice((2, 2, 50)) + data[end:],
                data[:start],
                data[:start] + rng.randbytes(len(part)) + data[end:],
                data[:start] + rng.choice((b"\0", b"\xff", b"\r", b"\n\n", b"\xef\xbb\xbf")) + data[end:],
                data[end:] + data[:start],
            )
        )
    return data


def words(data: bytes, rng: random.Random) -> bytes:
    """A text with one to three of its words or numbers exchanged, or a line cut out, repeated or moved."""
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        kind = rng.random()
        if kind < 0.75:
            found = list((_NUMBER if kind < 0.5 else _WORD).finditer(data))
            if found:
                one = rng.choice(found)
                new = rng.choice(NUMBERS) if kind < 0.15 else scalar(rng)
                if 0.15 <= kind < 0.45 and len(one[0]) < 20:
                    is_whole = one[0].lstrip(b"-").isdigit()
                    new = f"{near(int(one[0]) if is_whole else float(one[0]), rng):.12g}"
                data = data[: one.start()] + new.encode() + data[one.end() :]
            continue
        lines = data.splitlines(keepends=True) or [b""]
        at = rng.randrange(len(lines))
        line = lines.pop(at)
        for _ in range(rng.choice((0, 1, 2, 3))):
            lines.insert(rng.randrange(len(lines) + 1), line)
        data = b"".join(lines)
    return data


def tree(data: bytes, rng: random.Random) -> bytes:
    """A YAML or JSON text with one to three of its values or keys exchanged, removed, doubled or nested."""
    values = yaml.safe_load(data)
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        places = list(_places(values))
        if not places:
            break
        holder, key = rng.choice(places)
        kind = rng.random()
        if kind < 0.45 and isinstance(holder[key], int | float):
            holder[key] = near(holder[key], rng)
        elif kind < 0.6:
            holder[key] = value(rng)
        elif kind < 0.68:
            del holder[key]
        elif kind < 0.75:
            holder[key] = [holder[key]] * rng.choice((0, 1, 2, 40))
        elif kind < 0.85:
            holder[key] = {rng.choice(TEXTS): holder[key]}
        elif isinstance(holder, list):
            holder.insert(key, holder[key])
        else:
            holder[_key(rng, str(key))] = holder.pop(key)
    return yaml.safe_dump(values, allow_unicode=True, sort_keys=False).encode()


def _places(values: Any) -> Any:
    """Every list or mapping below ``values``, with each index or key of it."""
    pairs = (
        values.items() if isinstance(values, dict) else enumerate(values) if isinstance(values, list) else ()
    )
    for key, value in list(pairs):
        yield values, key
        yield from _places(value)


def value(rng: random.Random) -> Any:
    """The same as YAML reads it, or the text itself."""
    text = scalar(rng)
    if rng.random() < 0.3:
        return text
    try:
        return yaml.safe_load(text)
    except (yaml.YAMLError, ValueError, RecursionError):
        return text


def _key(rng: random.Random, key: str) -> str:
    return rng.choice((f"{key}x", key[:-1], key.upper(), rng.choice(TEXTS)))


def text_file(data: bytes, rng: random.Random | None, is_tree: bool = False) -> bytes:
    """A text, mutated in one of the ways, or as it is; ``is_tree``: it is YAML or JSON."""
    if rng is None:
        return data
    kind = rng.random()
    if is_tree and kind < 0.6:
        return tree(data, rng)
    return words(data, rng) if kind < 0.85 else file_bytes(data, rng)


def png(data: bytes, rng: random.Random) -> bytes:
    """A PNG with a byte of a chunk changed, or a chunk cut out or repeated; every checksum fits."""
    chunks = []
    position = 8
    while position + 8 <= len(data):
        length, kind = struct.unpack(">I4s", data[position : position + 8])
        chunks.append([kind, data[position + 8 : position + 8 + length]])
        position += 12 + length
    at = rng.randrange(len(chunks))
    what = rng.random()
    if what < 0.7:
        body = bytearray(chunks[at][1] or b"\0")
        body[rng.randrange(min(len(body), 20))] = rng.choice((0, 1, 2, 3, 4, 6, 8, 16, 127, 255))
        chunks[at][1] = bytes(body)
    elif what < 0.85:
        del chunks[at]
    else:
        chunks.insert(rng.randrange(len(chunks) + 1), chunks[at])
    return data[:8] + b"".join(
        struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
        for kind, body in chunks
    )
