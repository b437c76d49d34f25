"""Edits of single values in the text of a robot file; the rest is unchanged."""

from __future__ import annotations

import copy
import re
import tomllib
from pathlib import Path
from typing import Any

from simulator.robot import shipped_robot_text, shipped_robots
from simulator.units import other_keys


def robot_text(name_or_path: Path | str) -> str:
    """Text of a robot file, shipped or the user's own."""
    name = str(name_or_path)
    return shipped_robot_text(name) if name in shipped_robots() else Path(name).read_text(encoding="utf-8")


def with_value(text: str, table: str, name: str, value: float, remark: str) -> str:
    """The text with table.name set, and the former value and the remark in a comment if possible.

    Regardless of the notation of the key (in its table, dotted, inline), only its value is changed; a missing key is
    added. A value in another unit keeps its unit.
    """
    content = tomllib.loads(text)
    for key, factor in other_keys(name).items():
        if key in content.get(table, {}):
            name, value = key, value / factor
    wanted = copy.deepcopy(content)
    written = float(number(value))
    wanted.setdefault(table, {})[name] = written
    for match in re.finditer(rf"(?<![\w-]){re.escape(name)}[\"']?\s*=\s*([^\s,#}}\]]+)", text):
        changed = text[: match.start(1)] + number(value) + text[match.end(1) :]
        if _parsed(changed) != wanted:
            continue
        return _remarked(changed, match.start(1), f"{match[1]} {remark}", wanted)
    line = f"{name} = {number(value)}  # the default {remark}"
    header = re.search(rf"^\[{re.escape(table)}\][^\n]*\n", text, flags=re.MULTILINE)
    if header:
        return f"{text[: header.end()]}{line}\n{text[header.end() :]}"
    return f"{text.rstrip()}\n\n[{table}]\n{line}\n"


def with_values_of_each(text: str, table: str, name: str, factor: float, remark: str) -> str:
    """The text with a number of every [[table]] multiplied by a factor, the former value and the remark in a comment.

    A table that the file writes in another way than a key a line, below its header, stays as it is.
    """
    wanted = copy.deepcopy(tomllib.loads(text))
    names = {name, *other_keys(name)}
    header, begin = f"[[{table}]]", re.compile(r"^\s*\[")
    key = re.compile(rf"^(\s*({'|'.join(map(re.escape, sorted(names)))})\s*=\s*)([-+\w.]+)")
    inside, lines = False, []
    for line in text.splitlines(keepends=True):
        if begin.match(line):
            inside = line.strip().startswith(header)
        found = key.match(line) if inside else None
        if found:
            written, end = number(float(found[3]) * factor), line[found.end() :].rstrip()
            joint = f"{end}; " if "#" in end else "  # "
            line = f"{found[1]}{written}{joint}{found[3]} {remark}\n"  # noqa: PLW2901  # the line as it is to be written
        lines.append(line)
    for item in wanted.get(table, []):
        for there in names & set(item):
            item[there] = float(number(item[there] * factor))
    changed = "".join(lines)
    return changed if _parsed(changed) == wanted else text


def number(value: float) -> str:
    """A float as TOML writes it."""
    text = f"{value:.8g}"
    return text if any(mark in text for mark in ".en") else f"{text}.0"


def _remarked(text: str, at: int, remark: str, wanted: dict[str, Any]) -> str:
    """The text with a remark at the end of a line, after the comment that is there, if that changes nothing else."""
    end = text.find("\n", at)
    end = len(text) if end < 0 else end
    joint = "; " if "#" in text[at:end] else "  # "
    remarked = f"{text[:end].rstrip()}{joint}{remark}{text[end:]}"
    return remarked if _parsed(remarked) == wanted else text


def _parsed(text: str) -> dict[str, Any] | None:
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return None
