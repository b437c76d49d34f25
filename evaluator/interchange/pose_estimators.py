"""Files of pose estimators as named points: DeepLabCut and SLEAP (CSV and HDF5), movement."""

from __future__ import annotations

import csv
import io
import pickle
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from evaluator.errors import InputError
from evaluator.files.time_limit import limited
from evaluator.interchange.named_points import FileHints, NamedPoints

Array = NDArray[np.float64]
MOST_NUMBERS = 50_000_000  # of a variable: ten points of ten individuals for two hours at 60 frames a second
# How HDF5 refers to a text of any length.
TEXT = np.dtype([("length", "<u4"), ("heap", "<u8"), ("object", "<u4")])
DEEPLABCUT_KEY = "df_with_missing"  # of the table in the HDF5 that DeepLabCut writes


def read_deeplabcut(path: Path, said: FileHints) -> NamedPoints:
    """Header lines scorer, (individuals,) bodyparts, coords; a row per frame, counted from 0. Raises InputError."""
    import pandas as pd

    with path.open(encoding="utf-8", newline="") as file:
        heads: list[list[str]] = []
        for row in csv.reader(file):
            heads.append(row)
            if row and row[0] == "coords":
                break
        else:
            raise InputError(f"{path}: starts like a DeepLabCut file, but has no line that starts with coords")
    named = {row[0]: row[1:] for row in heads}
    try:
        table = pd.read_csv(path, skiprows=len(heads), header=None, dtype=float).to_numpy()
    except (ValueError, pd.errors.ParserError) as error:
        raise InputError(f"{path}: {str(error).strip()}") from error
    parts = named.get("bodyparts", [])
    columns = list(zip(named.get("individuals", [""] * len(parts)), parts, named["coords"], strict=False))
    return _likely(path, table[:, 0], columns, table[:, 1:], said)


def read_sleap(path: Path, said: FileHints) -> NamedPoints:
    """CSV of SLEAP: track, frame_idx, NODE.x, NODE.y and NODE.score, a row for each frame and individual.

    Raises InputError.
    """
    import pandas as pd

    if said.rate_hz is None:
        raise InputError(f"{path}: SLEAP counts frames; give the frame rate: --rate-hz, or rate_hz in [tracks]")
    try:
        table = pd.read_csv(path)
        numbers = table.drop(columns="track").astype(float)
    except (ValueError, IndexError, pd.errors.ParserError) as error:
        raise InputError(f"{path}: {str(error).strip()}") from error
    frames, at = np.unique(numbers["frame_idx"].to_numpy(), return_inverse=True)
    named = [name.removesuffix(".x") for name in map(str, numbers) if name.endswith(".x")]
    nodes = [name for name in named if f"{name}.y" in numbers]
    points = dict[tuple[str, str], Array]()
    for individual, rows in table["track"].fillna("").astype(str).groupby(table["track"].fillna("")).indices.items():
        if len(set(at[rows])) < len(rows):
            raise InputError(f"{path}: several individuals without a track in one frame; track them in SLEAP")
        for node in nodes:
            place = numbers[[f"{node}.x", f"{node}.y"]].to_numpy()[rows]
            if f"{node}.score" in numbers:
                place = np.where(numbers[f"{node}.score"].to_numpy()[rows, None] < said.likelihood, np.nan, place)
            points[str(individual), node] = np.full((len(frames), 2), np.nan)
            points[str(individual), node][at[rows]] = place
    return NamedPoints(frames / said.rate_hz, _plainly_named(points), "px")


def _plainly_named(points: dict[tuple[str, str], Array]) -> dict[str, Array]:
    """Points by the name of their part, with that of their individual before it if several have this part."""
    parts = [part for _, part in points]
    return {
        part if parts.count(part) == 1 else f"{individual}_{part}": place
        for (individual, part), place in points.items()
    }


def read_binary(path: Path, said: FileHints) -> NamedPoints:
    """HDF5 of SLEAP or DeepLabCut, or netCDF of movement."""
    with path.open("rb") as file:
        is_hdf5 = file.read(4) == b"\x89HDF"
    with limited():  # a damaged file can make HDF5 loop without end
        return (_read_hdf5(path, said) if is_hdf5 else None) or _read_movement(path, said)


def _read_hdf5(path: Path, said: FileHints) -> NamedPoints | None:
    """Read an analysis file of SLEAP or the table of DeepLabCut; None for any other HDF5 file."""
    try:
        import h5py
    except ImportError as error:
        raise InputError(f"{path}: HDF5 needs h5py: pip install 'turnscope[netcdf]'") from error
    try:
        with h5py.File(path, "r") as file:
            _check_texts(path, file)
            if DEEPLABCUT_KEY in file:
                return _deeplabcut_table(path, file[DEEPLABCUT_KEY], said)
            if {"tracks", "node_names"} <= set(file):
                return _sleap_analysis(path, file, said)
            is_project = {"instances", "points"} <= set(file)
    except InputError:
        raise
    except (OSError, IndexError, AttributeError, KeyError, ValueError, TypeError) as error:
        raise InputError(f"{path}: not a readable HDF5 file ({error})") from error
    if is_project:
        raise InputError(f"{path}: a project of SLEAP; export it there as an analysis file (HDF5 or CSV)")
    return None


def _check_texts(path: Path, file: Any) -> None:
    """Raise ValueError if a text claims more bytes than the file has: HDF5 would reserve them before it notices."""
    import h5py

    size = path.stat().st_size
    with path.open("rb") as content:
        for name, found in file.items():
            text = isinstance(found, h5py.Dataset) and h5py.check_string_dtype(found.dtype)
            if not text or text.length is not None or (offset := found.id.get_offset()) is None:
                continue
            content.seek(offset)
            lengths = np.frombuffer(content.read(min(found.size * TEXT.itemsize, size)), TEXT)["length"]
            if lengths.max(initial=0) > size:
                raise ValueError(f"{name} holds a text of {lengths.max():.3g} bytes, more than the file")


def _sleap_analysis(path: Path, file: Any, said: FileHints) -> NamedPoints:
    """Tracks (individuals, 2, nodes, frames)."""
    if said.rate_hz is None:
        raise InputError(f"{path}: SLEAP counts frames; give the frame rate: --rate-hz, or rate_hz in [tracks]")
    place, nodes = file["tracks"][:], [name.decode() for name in file["node_names"][:]]
    score = file["point_scores"][:] if "point_scores" in file else np.ones_like(place[:, 0])
    stated = [name.decode() for name in file["track_names"][:]] if "track_names" in file else []
    individuals = stated if len(stated) == len(place) else [f"track{k}" for k in range(len(place))]
    points = {}
    for k, individual in enumerate(individuals):
        for node, name in enumerate(nodes):
            unlikely = score[k, node, :, None] < said.likelihood
            points[individual, name] = np.where(unlikely, np.nan, place[k, :, node].T)
    return NamedPoints(np.arange(place.shape[-1]) / said.rate_hz, _plainly_named(points), "px")


def _deeplabcut_table(path: Path, group: Any, said: FileHints) -> NamedPoints:
    """A pandas table as PyTables stores it: rows of an index and one block of numbers; names in an attribute."""
    columns: list[tuple[Any, ...]] = []
    if "table" in group:
        rows = group["table"][:]
        columns = _plain_pickle(bytes(group.attrs["non_index_axes"]))[0][1]
        frames, values = rows["index"], rows["values_block_0"]
    else:  # the fixed format: levels of the names and which of them each column has
        frames, values = group["axis1"][:], group["block0_values"][:]
        count = sum(key.startswith("block0_items_level") for key in group)
        levels = [[item.decode() for item in group[f"block0_items_level{k}"][:]] for k in range(count)]
        codes = [group[f"block0_items_label{k}"][:] for k in range(count)]
        columns = [
            tuple(level[code] for level, code in zip(levels, row, strict=True)) for row in zip(*codes, strict=True)
        ]
    named = [(str(column[-3]) if len(column) > 3 else "", str(column[-2]), str(column[-1])) for column in columns]
    return _likely(path, np.asarray(frames, float), named, np.asarray(values, float), said)


class _PlainUnpickler(pickle.Unpickler):
    """Reads lists, tuples, strings and numbers, and no executable objects."""

    def find_class(self, module_name: str, global_name: str, /) -> NoReturn:
        raise pickle.UnpicklingError(f"{module_name}.{global_name} is no list of names")


def _plain_pickle(content: bytes) -> Any:
    try:
        return _PlainUnpickler(io.BytesIO(content)).load()
    except (pickle.UnpicklingError, EOFError) as error:
        raise ValueError(str(error)) from error


def _likely(
    path: Path, frames: Array, columns: Sequence[tuple[str, str, str]], values: Array, said: FileHints
) -> NamedPoints:
    """Points of a table whose columns are (individual, point, coordinate); unlikely ones are missing."""
    if said.rate_hz is None:
        raise InputError(f"{path}: DeepLabCut counts frames; give the frame rate: --rate-hz, or rate_hz in [tracks]")
    at = {column: k for k, column in enumerate(columns)}
    points = {}
    for individual, name in dict.fromkeys(column[:2] for column in columns):
        x, y, likelihood = (at.get((individual, name, part)) for part in ("x", "y", "likelihood"))
        if x is not None and y is not None:
            place = values[:, [x, y]].copy()
            if likelihood is not None:
                place[values[:, likelihood] < said.likelihood] = np.nan
            points[individual, name] = place
    return NamedPoints(frames / said.rate_hz, _plainly_named(points), "px")


def _read_movement(path: Path, said: FileHints) -> NamedPoints:
    """A movement dataset: position over time, space, keypoints, individuals; confidence if there is one."""
    data = _opened(path)
    time = data["time"].to_numpy().astype(float)
    if data.attrs.get("time_unit") == "frames":
        rate = said.rate_hz or data.attrs.get("fps")
        if not rate:
            raise InputError(f"{path}: counts frames; give the frame rate: --rate-hz, or rate_hz in [tracks]")
        time = time / float(rate)
    position = data["position"].transpose("individuals", "keypoints", "time", "space").to_numpy().astype(float)
    xy = [_words(data["space"]).index(axis) for axis in "xy"]
    sure = np.ones_like(position[..., 0])
    if "confidence" in data:
        sure = data["confidence"].transpose("individuals", "keypoints", "time").to_numpy()
    points = {}
    for k, individual in enumerate(_words(data["individuals"])):
        for node, name in enumerate(_words(data["keypoints"])):
            points[individual, name] = position[k, node][:, xy]
            points[individual, name][sure[k, node] < said.likelihood] = np.nan
    return NamedPoints(time, _plainly_named(points), "px")


def _opened(path: Path) -> Any:
    """The dataset with dimensions time, space, keypoints and individuals. Raises InputError if it has no position."""
    try:
        import xarray as xr
    except ImportError as error:
        raise InputError(f"{path}: netCDF needs xarray: pip install 'turnscope[netcdf]'") from error

    try:
        # By name, because the default of xarray depends on installed packages.
        with path.open("rb") as file:
            engine = "scipy" if file.read(3) == b"CDF" else "h5netcdf"
        with xr.open_dataset(path, engine=engine) as opened:
            numbers = max((variable.size for variable in opened.variables.values()), default=0)
            data = opened.load() if numbers <= MOST_NUMBERS else None
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: not a readable netCDF file ({str(error).splitlines()[0]})") from error
    if data is None:
        raise InputError(f"{path}: a variable of {numbers:.3g} numbers is no track; is the file damaged?")
    data = data.rename({name: f"{name}s" for name in ("keypoint", "individual") if name in data.dims})
    if "position" not in data or not {"time", "space", "keypoints"} <= set(data["position"].dims):
        raise InputError(
            f"{path}: no position over time, space and keypoints in it; is it a movement dataset of poses?"
        )
    return data if "individuals" in data.dims else data.expand_dims(individuals=[""])


def _words(coordinate: Any) -> list[str]:
    return [name.decode() if isinstance(name, bytes) else str(name) for name in coordinate.to_numpy()]
