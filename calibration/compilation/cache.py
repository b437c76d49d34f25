"""Cache of compiled kernels on disk: location, validity by source text, and locks between processes.

Location: `turnscope/kernels` in the user's cache, or NUMBA_CACHE_DIR if set; otherwise `__pycache__` beside the source;
otherwise, as in a container that is read-only, a folder of the user's own among the temporary files. If none is
writable, nothing is cached. A file name contains the digest of the kernel's source file and of all files
that it imports from these packages, directly or indirectly; numba adds its version, the processor and argument types.
"""

from __future__ import annotations

import os
import re
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache, cached_property
from hashlib import sha256
from pathlib import Path
from stat import S_ISDIR
from typing import Any

from numba.core import config
from numba.core.caching import Cache, CompileResultCacheImpl, NullCache, _CacheLocator
from numba.core.compiler_lock import global_compiler_lock

from calibration.compilation.lookups import fast_lookups

ROOT = Path(__file__).parents[2]  # of the packages
IMPORTED = re.compile(
    r"^[ \t]*from[ \t]+((?:calibration|simulator|evaluator)[\w.]*)[ \t]+import[ \t]+(\([^)]*\)|.*)", re.MULTILINE
)
OLD_S = 60 * 86400.0  # age at which files of a kernel are deleted when it is compiled again
LONGEST_S = 120.0  # longest wait for a lock on an idle machine, where the largest kernel takes 18 s
POLLED_S = 0.05  # between two looks at a lock: far below the seconds of a compilation


def keep_on_disk(kernel: Any) -> None:
    """Make a kernel use the cache on disk: it is read from there, or compiled by one process at a time and stored."""
    on_disk = _OnDisk(kernel.py_func)
    kernel._cache = on_disk  # noqa: SLF001  # numba offers no public way to choose the folder of a kernel's files
    compile_now = kernel.compile

    def compile_alone(signature: Any) -> Any:
        with global_compiler_lock, _alone(on_disk.index), fast_lookups():
            entry = compile_now(signature)
        _give_environments(kernel)
        return entry

    kernel.compile = compile_alone


def is_on_disk(kernel: Any) -> bool:
    """Whether something compiled from the present sources of the kernel is on disk."""
    index = kernel._cache.index  # noqa: SLF001
    return index is not None and index.exists()


class _OnDisk:
    """numba's cache of one kernel, created on first use, so that a command pays only for the kernels that it calls."""

    def __init__(self, function: Any) -> None:
        self._function = function

    @cached_property
    def _cache(self) -> Any:
        try:
            return _KernelCache(self._function)
        except RuntimeError:  # no folder can be written, or there is no source
            return NullCache()

    @property
    def index(self) -> Path | None:
        """Index file of the kernel's cached versions; None if nothing can be cached."""
        path = self._cache.cache_path
        return path and Path(path) / f"{self._cache._impl.filename_base}.nbi"  # noqa: SLF001

    def load_overload(self, signature: Any, target: Any) -> Any:
        """Read a compiled version; None if it cannot be read, for instance after a disk error."""
        try:
            return self._cache.load_overload(signature, target)
        except Exception:  # noqa: BLE001  # a damaged pickle raises anything
            if self.index is not None:
                self.index.unlink(missing_ok=True)
            return None

    def save_overload(self, signature: Any, result: Any) -> None:
        """Store a compiled version if there is space, and delete old versions of this kernel."""
        with suppress(OSError):  # without it, the kernel is compiled again next time
            self._cache.save_overload(signature, result)
        if self.index is not None:
            for file in self.index.parent.glob(f"{self.index.name.split('-')[0]}-*"):
                with suppress(OSError):  # another process may be first
                    if file.stat().st_mtime < time.time() - OLD_S:
                        file.unlink()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._cache, name)


class _Place(_CacheLocator):  # type: ignore[misc, unused-ignore]  # numba is untyped
    """Folder and file name of a kernel in the cache."""

    def __init__(self, folder: Path, stamp: str, source: str) -> None:
        self._folder, self._stamp, self._py_file = folder, stamp, source

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> _Place | None:
        """The location of a function; None if nothing can be cached."""
        del py_func
        source = Path(py_file)
        if not source.is_file():
            return None
        folder = _folder(source.parent)
        return None if folder is None else cls(folder, digest(source), py_file)

    def get_cache_path(self) -> str:
        """The folder."""
        return str(self._folder)

    def get_source_stamp(self) -> str:
        """Digest that identifies the sources."""
        return self._stamp

    def get_disambiguator(self) -> str:
        """Suffix that distinguishes files of one kernel, since versions of turnscope may share the cache."""
        return self._stamp[:16]


class _KernelFiles(CompileResultCacheImpl):  # type: ignore[misc, unused-ignore]
    _locator_classes = [_Place]  # noqa: RUF012  # a list, as in numba's base class


class _KernelCache(Cache):  # type: ignore[misc, unused-ignore]
    _impl_class = _KernelFiles


def digest(source: Path) -> str:
    """Digest of the texts of a file and of all files of these packages that it imports, directly or not."""
    found, ahead = {source}, [source]
    while ahead:
        for other in _read(ahead.pop())[1] - found:
            found.add(other)
            ahead.append(other)
    texts = sorted(_read(file)[0] for file in found - {source})
    return sha256("".join([_read(source)[0], *texts]).encode()).hexdigest()


@cache
def _read(source: Path) -> tuple[str, frozenset[Path]]:
    """Digest of the text of a file, and the files of these packages that it imports."""
    text = source.read_bytes()
    files = set()
    for module, names in IMPORTED.findall(text.decode(errors="replace")):
        folder = ROOT.joinpath(*module.split("."))
        files |= {folder.with_suffix(".py"), folder / "__init__.py"}
        files |= {folder / f"{name}.py" for name in re.findall(r"\w+", names)}
    # This file affects where kernels are stored, not their content.
    return sha256(text).hexdigest(), frozenset(file for file in files if file.is_file() and file != Path(__file__))


@cache
def _folder(beside: Path) -> Path | None:
    """The first folder that can be written, in the order of the module's docstring."""
    wanted = [Path(config.CACHE_DIR)] if config.CACHE_DIR else []
    with suppress(RuntimeError):  # no home directory
        wanted.append(_user_cache() / "turnscope" / "kernels")
    for folder in (*wanted, beside / "__pycache__"):
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=folder).close()
            return folder
    return _temporary()


def _temporary() -> Path | None:
    """A folder among the temporary files that only this user can write; None if there is none.

    Kernels are code, and everybody can create a folder of this name first. On Windows the user's cache is always there.
    """
    if not hasattr(os, "getuid"):
        return None
    folder = Path(tempfile.gettempdir()) / f"turnscope-kernels-{os.getuid()}"
    with suppress(OSError):
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
        if S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o022:
            tempfile.TemporaryFile(dir=folder).close()
            return folder
    return None


def _user_cache() -> Path:
    """The system's folder for caches."""
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")


@contextmanager
def _alone(index: Path | None) -> Iterator[None]:
    """Hold the lock of a kernel, if the system has file locks, so that no other process compiles it.

    After LONGEST_S, for instance if the process with the lock is suspended, the kernel is compiled without the lock. If
    several programs share a core, the wait is longer by their number: without this, three processes of a demo beside 20
    other programs compiled the largest kernels three times.
    """
    if index is None or sys.platform == "win32":
        yield
        return
    import fcntl

    try:
        lock = index.with_suffix(".lock").open("wb")
    except OSError:
        yield
        return
    ends = time.monotonic() + LONGEST_S * max(_programs_a_core(), 1.0)
    with lock:
        while time.monotonic() < ends:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                time.sleep(POLLED_S)
            except OSError:  # a file system without locks
                break
            else:
                break
        yield


def _programs_a_core() -> float:
    """Programs that share a core, in the mean of the last minute; 0 where the system does not say."""
    try:
        return os.getloadavg()[0] / (os.cpu_count() or 1)
    except OSError:
        return 0.0


def _give_environments(kernel: Any) -> None:
    """Set the environments of the parts in a kernel, which their errors need; numba sets only that of the kernel."""
    for result in kernel.overloads.values():
        for environment in result._find_referenced_environments():  # noqa: SLF001
            result.library.codegen.set_env(environment.env_name, environment)
