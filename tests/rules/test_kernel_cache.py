"""Cache of compiled kernels in a folder named by the digest of their sources."""

import os
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import sim._kernels as kernels
from sim._kernels import cache

KERNEL = """
import numba as nb
from cached.law import law

@nb.njit(cache=True)
def kernel(x):
    return law(x)
"""
LAW = "import numba as nb\n@nb.njit(cache=True)\ndef law(x):\n    return {factor} * x\n"
MAIN = """
from pathlib import Path
import sim._kernels.cache as cache
with cache.kernel_cache(Path("cached")):
    from cached.kernel import kernel
print(kernel(1.0), sum(kernel.stats.cache_hits.values()))
"""


def run(folder: Path, code: str = MAIN, **env: str) -> str:
    root = str(Path(cache.__file__).resolve().parents[2])
    done = subprocess.run(
        [sys.executable, "-W", "always", "-c", code],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": f"{folder}{os.pathsep}{root}", **env},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout + done.stderr


def test_an_edited_law_is_not_loaded_from_the_cache_of_another_file(tmp_path):
    package = tmp_path / "cached"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "kernel.py").write_text(KERNEL)
    (package / "law.py").write_text(LAW.format(factor=2.0))
    env = {"EMGFACE_CACHE": str(tmp_path / "cache")}
    assert run(tmp_path, **env).startswith("2.0 0")
    assert run(tmp_path, **env).startswith("2.0 1")  # loaded from disk
    (package / "law.py").write_text(LAW.format(factor=3.0))
    assert run(tmp_path, **env).startswith("3.0 0")


def test_every_module_of_kernels_is_cached_under_the_digest():
    """numba would cache modules that `sim._kernels` does not import under its own key."""
    folder = Path(kernels.__file__).parent
    modules = {path.stem for path in folder.glob("*.py")} - {"__init__"}
    assert modules <= set(vars(kernels))


def test_a_lock_lets_one_compile_at_a_time_and_needs_no_writable_folder(tmp_path):
    order: list[int] = []

    def work(number: int) -> None:
        with cache.in_one_process(tmp_path / "new" / "kernel.lock"):
            order.append(number)
            time.sleep(0.05)
            order.append(number)

    with ThreadPoolExecutor(3) as pool:
        list(pool.map(work, range(3)))
    assert sorted(order) == [0, 0, 1, 1, 2, 2] and order[::2] == order[1::2]
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    with pytest.raises(ZeroDivisionError), cache.in_one_process(blocked / "kernel.lock"):
        raise ZeroDivisionError  # the block runs, and its error is raised unchanged


def test_digest_changes_with_any_source(tmp_path):
    (tmp_path / "a.py").write_text("x = 1\n")
    before = cache.source_digest(tmp_path)
    assert cache.source_digest(tmp_path) == before
    (tmp_path / "a.py").write_text("x = 2\n")
    assert cache.source_digest(tmp_path) != before


def test_a_cache_that_cannot_be_written_gives_a_warning(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    package = tmp_path / "cached"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "kernel.py").write_text(KERNEL)
    (package / "law.py").write_text(LAW.format(factor=2.0))
    output = run(tmp_path, EMGFACE_CACHE=str(blocked))
    assert "2.0 0" in output
    assert "set EMGFACE_CACHE to a writable folder" in output


def test_cache_root_follows_the_environment(monkeypatch, tmp_path):
    monkeypatch.setenv("EMGFACE_CACHE", str(tmp_path))
    assert cache.cache_root() == tmp_path
    monkeypatch.delenv("EMGFACE_CACHE")
    assert cache.cache_root().name == "emgface"
    with pytest.warns(cache.KernelCacheWarning):
        monkeypatch.setenv("EMGFACE_CACHE", os.devnull)
        cache.cache_folder(tmp_path)
