"""Kernels are compiled where they are called from Python, once for the same sources, wherever these are installed."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np
import pytest

from calibration.compilation import cache, compiled
from calibration.compilation.parts import _PartCompiler

ROOT = Path(__file__).parents[2]
KERNELS = """
from calibration.compilation import compiled

@compiled()
def square(x):
    return x * x

@compiled(fastmath=True)
def total(x):
    return square(x) + square(x + 1.0) + 0.5

@compiled(forceinline=True)
def linked(x):
    return total(x) - square(x)

@compiled()
def whole(x):
    return linked(x) + total(x)
"""
LINE = "import own_kernels as k; print(k.whole(3.0), sum(k.whole.stats.cache_misses.values()), flush=True)"
# A process that knows nothing of these packages yet, forked from one that has loaded numba: to load it takes most
# of the time. Other tests start processes from nothing (tests/simulator/test_compiled.py).
FORKING = """
import json, os, sys
from numba import njit
from numba.core import config

njit(lambda x: x + 1.0)(1.0)  # loads the rest of the compiler
sys.dont_write_bytecode = True
for asked in sys.stdin:
    folder, root, around, line = json.loads(asked)
    if child := os.fork():
        print("status", os.waitpid(child, 0)[1], flush=True)
        continue
    try:
        os.chdir(folder)
        os.environ.clear()
        os.environ.update(around)
        config.reload_config()
        sys.path[:0] = folder, root
        exec(line)
        os._exit(0)
    finally:
        os._exit(1)
"""
Run = Callable[..., list[str]]


@pytest.fixture(scope="module")
def run() -> Iterator[Run]:
    """What runs LINE in a process of its own, and returns its words."""
    if not hasattr(os, "fork"):
        yield _started
        return
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen([sys.executable, "-c", FORKING], text=True, **pipes) as server:
        assert server.stdin is not None
        assert server.stdout is not None
        answers, asked = server.stdout, server.stdin

        def forked(folder: Path, kept: Path | None, **more: str) -> list[str]:
            print(json.dumps([str(folder), str(ROOT), _around(kept, **more), LINE]), file=asked, flush=True)
            *lines, status = _until_status(answers)
            assert status == "status 0"
            return " ".join(lines).split()

        yield forked


def _until_status(answers: Iterable[str]) -> Iterator[str]:
    for line in answers:
        yield line.strip()
        if line.startswith("status"):
            return


def _around(kept: Path | None, **more: str) -> dict[str, str]:
    """The environment of a process whose kernels are kept in a folder, or where its machine keeps them."""
    usual = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    return usual | ({"NUMBA_CACHE_DIR": str(kept)} if kept is not None else {}) | more


def _started(folder: Path, kept: Path | None, **more: str) -> list[str]:
    around = _around(kept, **more) | {"PYTHONPATH": os.pathsep.join([str(folder), str(ROOT)])}
    line = [sys.executable, "-B", "-c", LINE]
    done = subprocess.run(line, cwd=folder, env=around, capture_output=True, text=True, check=True, timeout=300)
    return done.stdout.split()


def written(folder: Path) -> Path:
    folder.mkdir()
    (folder / "own_kernels.py").write_text(KERNELS, encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def once(tmp_path_factory: pytest.TempPathFactory, run: Run) -> Path:
    """A folder whose kernels have been compiled once, and in it what was kept of them; nobody writes into it."""
    folder = written(tmp_path_factory.mktemp("once") / "a")
    assert run(folder, folder / "kept") == ["42.0", "1"]
    return folder


@pytest.fixture
def compiled_before(once: Path, tmp_path: Path) -> Path:
    """The sources in another place, with what was kept of them: all that a second installation finds."""
    folder = shutil.copytree(once, tmp_path / "elsewhere", ignore=shutil.ignore_patterns("__pycache__"))
    os.utime(folder / "own_kernels.py")
    return Path(folder)


def test_parts_are_compiled_into_their_caller_and_only_what_is_called_is_kept(once: Path) -> None:
    names = {file.name.split("-")[0] for file in (once / "kept").glob("*.nbc")}
    assert names == {"own_kernels.whole"}


def test_what_a_kernel_calls_is_neither_written_out_nor_rounded_as_the_kernel_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    options: dict[str, tuple[bool, bool]] = {}
    compile_part = _PartCompiler.compile_extra

    def noted(self: _PartCompiler, func: Callable[..., object]) -> object:
        options[func.__name__] = self.state.flags.forceinline, bool(self.state.flags.fastmath)
        return compile_part(self, func)

    monkeypatch.setattr(_PartCompiler, "compile_extra", noted)
    monkeypatch.setattr(cache.config, "CACHE_DIR", str(tmp_path))
    kernels: dict[str, Callable[..., object]] = {"__name__": "own_kernels"}  # type: ignore[dict-item]
    exec(KERNELS, kernels)  # noqa: S102  # no file, so that nothing is read from a cache
    assert kernels["whole"](3.0) == 42.0
    assert options == {"total": (False, True), "square": (False, False), "linked": (True, False)}


def test_a_second_installation_of_the_same_sources_compiles_nothing(compiled_before: Path, run: Run) -> None:
    assert run(compiled_before, compiled_before / "kept") == ["42.0", "0"]


def test_a_changed_kernel_is_compiled_anew_and_both_versions_are_kept(compiled_before: Path, run: Run) -> None:
    folder, kept = compiled_before, compiled_before / "kept"
    (folder / "own_kernels.py").write_text(KERNELS.replace("+ 0.5", "+ 1.5"), encoding="utf-8")
    assert run(folder, kept) == ["44.0", "1"]
    (folder / "own_kernels.py").write_text(KERNELS, encoding="utf-8")
    assert run(folder, kept) == ["42.0", "0"]


@pytest.mark.parametrize("kind", ["nbi", "nbc"])
def test_a_damaged_file_is_compiled_anew_and_mended(compiled_before: Path, kind: str, run: Run) -> None:
    folder, kept = compiled_before, compiled_before / "kept"
    for file in kept.glob(f"own_kernels.whole-*.{kind}"):
        file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    assert run(folder, kept) == ["42.0", "1"]
    assert run(folder, kept) == ["42.0", "0"]


def test_kernels_work_where_nothing_can_be_kept(tmp_path: Path, run: Run) -> None:
    folder = written(tmp_path / "a")
    (folder / "__pycache__").write_text("a file in the way", encoding="utf-8")
    taken = tmp_path / "file"
    taken.write_text("", encoding="utf-8")
    (tmp_path / f"turnscope-kernels-{getattr(os, 'getuid', int)()}").write_text("", encoding="utf-8")
    around = {"XDG_CACHE_HOME": str(taken), "LOCALAPPDATA": str(taken), "HOME": str(taken), "TMPDIR": str(tmp_path)}
    assert run(folder, None, **around) == ["42.0", "1"]


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="Windows always has the user's cache")
def test_where_home_and_installation_are_read_only_kernels_are_kept_among_the_temporary_files_of_the_user_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    monkeypatch.setattr(cache.config, "CACHE_DIR", "")
    monkeypatch.setattr(cache, "_user_cache", lambda: tmp_path / "file")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    find = cache._folder.__wrapped__
    folder = find(tmp_path / "file")
    assert folder.parent == tmp_path
    assert folder.stat().st_mode & 0o777 == 0o700
    folder.chmod(0o722)  # whoever else can write there can put code there
    assert find(tmp_path / "file") is None
    folder.rmdir()
    folder.symlink_to(tmp_path / "elsewhere")
    (tmp_path / "elsewhere").mkdir(mode=0o700)
    assert find(tmp_path / "file") is None


def test_kernels_are_kept_in_the_users_cache(tmp_path: Path, run: Run) -> None:
    if sys.platform != "linux":
        pytest.skip("other systems have other places")
    run(written(tmp_path / "a"), None, XDG_CACHE_HOME=str(tmp_path / "cache"))
    assert list((tmp_path / "cache" / "turnscope" / "kernels").glob("own_kernels.whole-*.nbc"))


def test_the_digest_changes_with_every_file_that_is_imported_and_with_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    texts = {
        "calibration/caller.py": "from calibration.room import callee\nfrom simulator.numbers import (\n    A,\n)\n",
        "calibration/room/__init__.py": "",
        "calibration/room/callee.py": "from evaluator.deeper import B\n",
        "simulator/numbers.py": "A = 1\n",
        "evaluator/deeper.py": "B = 1\n",
        "evaluator/other.py": "C = 1\n",
    }
    for name, text in texts.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    monkeypatch.setattr(cache, "ROOT", tmp_path)

    def digest() -> str:
        cache._read.cache_clear()
        return cache.digest(tmp_path / "calibration" / "caller.py")

    before = digest()
    changes = {}
    for name, text in texts.items():
        (tmp_path / name).write_text(text + "# more\n", encoding="utf-8")
        changes[name] = digest() != before
        (tmp_path / name).write_text(text, encoding="utf-8")
    cache._read.cache_clear()
    assert changes == {name: name != "evaluator/other.py" for name in texts}


def test_what_was_compiled_long_ago_goes_when_its_kernel_is_compiled_anew(tmp_path: Path, run: Run) -> None:
    kept = tmp_path / "kept"
    kept.mkdir()
    ages = {"own_kernels.whole-0.py311.nbi": 61, "own_kernels.whole-1.py311.nbi": 59, "own_kernels.other-0.nbi": 61}
    for name, days in ages.items():
        (kept / name).touch()
        os.utime(kept / name, ns=((then := int((Path(kept).stat().st_mtime - days * 86400) * 1e9)), then))
    run(written(tmp_path / "a"), kept)
    assert [name for name in ages if (kept / name).exists()] == list(ages)[1:]


@compiled()
def _reciprocal(x):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    return 1.0 / x


@compiled()
def _checked(values, row):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    if row >= len(values):
        raise ValueError("no such row")
    return values[row]


@compiled()
def _both(values, row):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    return _reciprocal(_checked(values, row))


def test_parts_divide_by_zero_as_numpy_does_and_raise_what_they_raise() -> None:
    assert np.isinf(_both(np.zeros(2), 1))
    with pytest.raises(ValueError, match="no such row"):
        _both(np.zeros(2), 2)


def test_a_process_that_was_suspended_while_it_compiles_is_not_waited_for_without_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fcntl = pytest.importorskip("fcntl", reason="this system has no such locks")
    monkeypatch.setattr(cache, "LONGEST_S", 0.001)
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    monkeypatch.setattr(os, "getloadavg", lambda: (400.0, 0.0, 0.0))
    began = time.monotonic()
    with (tmp_path / "kernel.lock").open("wb") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        with cache._alone(tmp_path / "kernel.nbi"):
            assert time.monotonic() - began >= 200 * 0.001  # longer on a busy machine
