"""Ways to spoil a valid file: bytes, containers of boxes, PNG heads, tables and trees of keys.

Every mutation takes its randomness from `random.Random`, which hypothesis can shrink and a seed can repeat.
"""

from __future__ import annotations

import copy
import datetime as dt
import json
import math
import random
import re
import struct
import tomllib
import zlib
from collections.abc import Callable
from typing import Any

Mutation = Callable[[random.Random, bytes], bytes]

# Numbers at which fields of formats change their meaning.
EDGES = (0, 1, 2, 7, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 0x10000, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFE, 0xFFFFFFFF)
ODD_NUMBERS = (
    0,
    -1,
    1,
    2,
    0.5,
    -0.0,
    1e-300,
    1e300,
    -1e300,
    math.nan,
    math.inf,
    -math.inf,
    2**31,
    2**63,
    -(2**63),
    10**30,
)
ODD_TEXTS = (
    "",
    " ",
    "\x00",
    "a\x00.csv",
    "\x1b[31mred",
    "=1+1",
    "../..",
    "/",
    "\n",
    "é" * 300,
    "x" * 5000,
    "𝔘🤖",
    "-",
    "nan",
    "barrel",
    "CON",
)
ODD_CELLS = (
    "",
    "nan",
    "inf",
    "-inf",
    "1e999",
    "1e300",
    "-1e300",
    "abc",
    '"',
    '"a,b"',
    "\t",
    ";",
    "1,5",
    "=2*3",
    "\x1b[2J",
    "0x10",
    "1_000",
    "٣",
    "True",
    "9" * 400,
)
TOKENS = re.compile(rb"[A-Za-z][A-Za-z0-9 ]{3}")


def of_bytes(rng: random.Random, content: bytes) -> bytes:  # noqa: C901  # one way after the other
    """Flip, set, cut, repeat, insert or move bytes."""
    data = bytearray(content)
    for _ in range(rng.choice((1, 1, 2, 5, 20))):
        if not data:
            return bytes(data)
        at = rng.randrange(len(data))
        length = min(rng.choice((1, 2, 4, 16, 64, 1000)), len(data) - at)
        kind = rng.randrange(8)
        if kind == 0:
            data[at] ^= 1 << rng.randrange(8)
        elif kind == 1:
            data[at] = rng.randrange(256)
        elif kind == 2:
            del data[at : at + length]
        elif kind == 3:
            data[at:at] = data[at : at + length]
        elif kind == 4:
            data[at:at] = rng.randbytes(length)
        elif kind == 5:
            data[at : at + length] = bytes(length)
        elif kind == 6:
            data[at : at + 4] = struct.pack(rng.choice("<>") + "I", rng.choice(EDGES))
        elif rng.random() < 0.3:
            del data[at:]
    return bytes(data)


def of_boxes(rng: random.Random, content: bytes) -> bytes:
    """Change a name of four letters (box, chunk, codec), or the numbers next to it."""
    data = bytearray(content)
    places = [found.start() for found in TOKENS.finditer(content[:4000] + bytes(8) + content[-4000:])]
    if not places:
        return of_bytes(rng, content)
    for _ in range(rng.choice((1, 1, 2, 4))):
        at = rng.choice(places)
        at = at if at < 4000 else len(data) - 4000 + (at - 4008) if len(content) > 4000 else at - 8
        at = max(0, min(at, len(data) - 8))
        kind = rng.randrange(4)
        if kind == 0:
            data[at : at + 4] = rng.choice((b"zzzz", b"free", b"\0\0\0\0", b"mp4v", b"hev1", b"av01", b"MJPG", b"trak"))
        elif kind == 1:
            data[max(at - 4, 0) : max(at - 4, 0) + 4] = struct.pack(">I", rng.choice(EDGES))
        else:
            place = min(at + 4 + 2 * rng.randrange(0, 30), len(data) - 4)
            form = rng.choice((">I", "<I", ">H", "B"))
            edge = rng.choice(EDGES) & (0xFFFFFFFF >> (32 - 8 * struct.calcsize(form)))
            data[place : place + struct.calcsize(form)] = struct.pack(form, edge)
    return bytes(data)


def of_png_head(rng: random.Random, content: bytes) -> bytes:
    """Say another size, depth or colour type in the head of a PNG, with the right checksum."""
    if not content.startswith(b"\x89PNG"):
        return of_boxes(rng, content)
    width, height, *rest = struct.unpack(">IIBBBBB", content[16:29])
    kind = rng.randrange(3)
    if kind == 0:
        width = rng.choice((*EDGES, 20_000, 65_000))
    elif kind == 1:
        height = rng.choice((*EDGES, 20_000, 65_000))
    else:
        rest[rng.randrange(5)] = rng.randrange(20)
    head = b"IHDR" + struct.pack(">IIBBBBB", width, height, *rest)
    return content[:12] + head + struct.pack(">I", zlib.crc32(head)) + content[33:]


def of_text(rng: random.Random, content: bytes) -> bytes:
    """Delete, repeat or move lines, or change characters that bind."""
    lines = content.split(b"\n")
    for _ in range(rng.choice((1, 1, 3))):
        at = rng.randrange(len(lines))
        kind = rng.randrange(5)
        if kind == 0 and len(lines) > 1:
            del lines[at]
        elif kind == 1:
            lines.insert(rng.randrange(len(lines) + 1), lines[at])
        elif kind == 2:
            lines[at] = lines[at].replace(
                rng.choice((b",", b"=", b'"', b".", b"[")), rng.choice((b"", b";", b"\0", b"\xff", b",,"))
            )
        elif kind == 3:
            lines[at] = lines[at][: rng.randrange(len(lines[at]) + 1)]
        else:
            lines[at] = of_bytes(rng, lines[at])
    return b"\n".join(lines)


def of_table(rng: random.Random, content: bytes) -> bytes:  # noqa: C901, PLR0912  # one way after the other
    """Change cells, rows and columns of a table of text."""
    separator = b"\t" if b"\t" in content.split(b"\n")[0] else b","
    rows = [line.split(separator) for line in content.split(b"\n") if line]
    if not rows:
        return of_bytes(rng, content)
    for _ in range(rng.choice((1, 1, 2, 6))):
        if not any(rows):  # all cells are deleted
            break
        row, column = rng.randrange(len(rows)), rng.randrange(max(map(len, rows)))
        kind = rng.randrange(9)
        if kind <= 2:
            if column < len(rows[row]):
                rows[row][column] = rng.choice(ODD_CELLS).encode()
        elif kind == 3:
            for each in rows:
                del each[column : column + 1]
        elif kind == 4:
            for each in rows[rng.randrange(2) :]:
                each[column : column + 1] = [rng.choice(ODD_CELLS).encode()]
        elif kind == 5:
            rows = rows[: row + 1]
        elif kind == 6:
            rows[row], rows[-1] = rows[-1], rows[row]
        elif kind == 7:
            rows[row] = rows[row] * 2
        else:
            for each in rows:
                each.insert(column, each[column] if column < len(each) else b"")
    return rng.choice((b"\n", b"\n", b"\n", b"\r\n", b"\r")).join(separator.join(row) for row in rows)


def of_toml(rng: random.Random, content: bytes) -> bytes:
    """Change keys and values of a TOML file, which stays valid TOML."""
    return toml_text(spoilt_tree(rng, tomllib.loads(content.decode()))).encode("utf-8", "surrogatepass")


def of_json(rng: random.Random, content: bytes) -> bytes:
    """Change keys and values of a JSON file, which stays valid JSON."""
    return json.dumps(spoilt_tree(rng, json.loads(content)), default=str).encode()


def spoilt_tree(rng: random.Random, tree: Any) -> Any:
    """Copy a tree of tables and lists with some places deleted, renamed, repeated or given odd values."""
    tree = copy.deepcopy(tree)
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        places = list(_places(tree))
        if not places:
            break
        parent, key = rng.choice(places)
        kind = rng.randrange(8)
        if kind == 0:
            del parent[key]
        elif kind == 1 and isinstance(parent, dict):
            parent[rng.choice((str(key) + "x", "", *ODD_TEXTS))] = parent.pop(key)
        elif kind == 2 and isinstance(parent, list):
            parent.extend(copy.deepcopy(parent) * rng.choice((1, 1, 40)))
        elif kind <= 5 and isinstance(parent[key], int | float) and not isinstance(parent[key], bool):
            parent[key] = rng.choice((*ODD_NUMBERS, parent[key] * rng.choice((-1, 1e-6, 1e6, 0.1, 10))))
        elif kind <= 5 and isinstance(parent[key], str):
            parent[key] = rng.choice(ODD_TEXTS)
        else:
            parent[key] = _odd_value(rng)
    return tree


def _odd_value(rng: random.Random) -> Any:
    values = (
        rng.choice(ODD_NUMBERS), rng.choice(ODD_TEXTS), True, [], {}, [[]], [1, "a"], {"a": {"b": []}},
        dt.datetime(1970, 1, 1, tzinfo=dt.UTC), [0.0] * 4, [{}],
    )  # fmt: skip
    return rng.choice(values)


def _places(tree: Any) -> Any:
    keys = list(tree) if isinstance(tree, dict) else range(len(tree)) if isinstance(tree, list) else ()
    for key in keys:
        yield tree, key
        yield from _places(tree[key])


def toml_text(tree: dict[str, Any]) -> str:
    """A tree as TOML, tables inline: what matters is that it is read back as it is."""
    return "".join(f"{json.dumps(key)} = {_toml_value(value)}\n" for key, value in tree.items())


def _toml_value(value: Any) -> str:  # noqa: PLR0911  # a line per type
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return (
            json.dumps(value).replace("\x7f", "\\u007f") if value.isascii() else json.dumps(value, ensure_ascii=False)
        )
    if isinstance(value, float):
        return {"nan": "nan", "inf": "inf", "-inf": "-inf"}.get(str(value), repr(value))
    if isinstance(value, dt.datetime):
        return value.isoformat()
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(key)} = {_toml_value(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml_value, value)) + "]"
    return str(value)
