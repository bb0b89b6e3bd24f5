"""Outcomes of damaged files: each reader on mutants of small valid files, bounded in time and memory.

    python -m benchmarks mutants [--reader NAME] [--mutants 1000] [--seed 0] [--listed 5]

A valid file of each format is made, damaged in one of the ways of `MUTATIONS`, and opened. Its outcome
is ``refused`` (typed, naming the file), ``unlocated`` (typed, without the file), ``reported`` (other
data with a new finding, warning or channel left out), ``same`` (the data of the valid file), ``silent``
(other data without a word), ``crash`` (untyped error, or end of the process), ``hang`` (over `SECONDS`
of processor time) or ``memory``. A changed sample is valid and necessarily silent; `--listed` silent
mutants of each mutation are therefore printed with their place. Simulated data throughout.
"""

import multiprocessing
import random
import resource
import signal
import tempfile
import warnings
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
import xarray as xr

from emgface.children import safe_children
from emgface.errors import DataError

SECONDS, MEMORY = 10, 3 << 30  #: limits of one mutant [s], and of its process [byte]
OUTCOMES = ("refused", "unlocated", "reported", "same", "silent", "crash", "hang", "memory")
Made = tuple[Path, Path, dict[str, str]]  #: path to open, file to damage, units of the mapping
LOADED = "tests.data.test_mutations", "tests.data.made_exports", "emgface.recordings.dataset"
_SIGNS = (b",", b";", b"\t", b".", b" ", b"-", b"e", b"\n", b"\r\n", b"9", b"0", b"nan", b'"')


def formats() -> dict[str, Callable[[Path], Made]]:
    """Makers of a small valid file of every reader, text export and companion file."""
    from tests.data.made_exports import EXPORTS
    from tests.data.test_mutations import FORMATS

    def binary(name: str) -> Callable[[Path], Made]:
        return lambda folder: (*FORMATS[name](folder), {})

    def export(name: str) -> Callable[[Path], Made]:
        def make(folder: Path) -> Made:
            suffix = ".txt" if name in ("AcqKnowledge", "OpenSignals") else ".csv"
            made = EXPORTS[name](folder / f"a{suffix}", np.random.default_rng(1))
            return made.path, made.path, made.units

        return make

    return {name: binary(name) for name in FORMATS} | {name: export(name) for name in EXPORTS}


def _swapped(data: bytearray, rng: random.Random, size: int) -> bytearray:
    a, b = sorted(rng.randrange(max(len(data) - size, 1)) for _ in range(2))
    data[a : a + size], data[b : b + size] = data[b : b + size], data[a : a + size]
    return data


def _of_lines(change: Callable[[list[bytes], int], Any]) -> Callable[..., bytearray]:
    def mutate(data: bytearray, rng: random.Random, at: int) -> bytearray:
        lines = bytes(data).splitlines(keepends=True)
        change(lines, rng.randrange(len(lines)))
        return bytearray(b"".join(lines))

    return mutate


def _replaced(data: bytearray, rng: random.Random, signs: tuple[bytes, ...]) -> bytearray:
    here = [sign for sign in signs if sign in data]
    old, new = rng.choice(here or [b"\0"]), rng.choice(signs)
    return data.replace(old, new, -1 if rng.random() < 0.5 else 1)


def _put(data: bytearray, at: int, remove: int, new: bytes) -> bytearray:
    data[at : at + remove] = new
    return data


MUTATIONS: dict[str, Callable[[bytearray, random.Random, int], bytearray]] = {
    "flip": lambda d, r, at: _put(d, at, 1, bytes([d[at] ^ (1 << r.randrange(8))])),
    "cut": lambda d, r, at: d[:at],
    "delete": lambda d, r, at: _put(d, at, r.randrange(1, 64), b""),
    "insert": lambda d, r, at: _put(d, at, 0, r.randbytes(r.randrange(1, 16))),
    "repeat": lambda d, r, at: _put(d, at, 0, bytes(d[at : at + r.randrange(1, 64)])),
    "swap": lambda d, r, at: _swapped(d, r, r.randrange(1, 32)),
    "extreme": lambda d, r, at: _put(d, at, 4, r.choice([b"\xff", b"\x7f", b"\0", b"9"]) * 4),
    "append": lambda d, r, at: d + r.randbytes(r.randrange(1, 200)),
    "mark": lambda d, r, at: r.choice([b"\xef\xbb\xbf", b"\xff\xfe"]) + d,
    "line lost": _of_lines(lambda lines, k: lines.pop(k)),
    "line twice": _of_lines(lambda lines, k: lines.insert(k, lines[k])),
    "line moved": _of_lines(lambda lines, k: lines.insert(0, lines.pop(k))),
    "sign": lambda d, r, at: _replaced(d, r, _SIGNS),
    "sign put": lambda d, r, at: _put(d, at, r.randrange(2), r.choice(_SIGNS)),
}


def mutant(whole: bytes, seed: str) -> tuple[str, int, bytes]:
    """Mutation, its place, and the damaged content, all from the seed; half are in the first kB."""
    rng = random.Random(seed)
    name = rng.choice(list(MUTATIONS))
    at = rng.randrange(len(whole) if rng.random() < 0.5 else min(len(whole), 1024))
    return name, at, bytes(MUTATIONS[name](bytearray(whole), rng, at))


def opened(path: Path, units: dict[str, str]) -> tuple[dict[str, Any], str]:
    """Arrays of a recording, and all other reports on it."""
    from emgface.recordings.dataset import read_recording

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        recording: xr.Dataset = read_recording(path, mapping={"units": units})
    messages = [recording.attrs.get(k, "") for k in ("findings", "flagged", "dropped")]
    arrays = {str(k): v.values.tolist() for k, v in recording.variables.items()}
    names = {k: recording.attrs.get(k) for k in ("volunteer", "instruction", "repetition")}
    return arrays | names, repr((messages, [str(w.message) for w in caught]))


def outcome(path: Path, units: dict[str, str], valid: tuple[str, str]) -> str:
    """Outcome of one damaged file in this process."""
    from emgface.errors import EmgfaceError

    try:
        arrays, messages = opened(path, units)
    except EmgfaceError as error:
        return "refused" if path.stem in str(error) else "unlocated"
    except MemoryError:
        return "memory"
    except Exception as error:
        return f"crash {type(error).__name__}: {str(error)[:80]}"
    same = repr(arrays) == valid[0]
    return "same" if same else "reported" if messages != valid[1] else "silent"


def worker(name: str, start: int, stop: int, first: int, pipe: Connection) -> None:
    """Send the outcomes of the mutants start..stop - 1, from place `first` on, to `outcomes`."""
    with tempfile.TemporaryDirectory() as folder:
        path, target, units = formats()[name](Path(folder))
        whole = target.read_bytes()
        arrays, said = opened(path, units)
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        for k in range(start, stop)[first:]:
            kind, at, data = mutant(whole, f"{name} {k}")
            target.write_bytes(data)
            pipe.send((kind, at))
            signal.setitimer(signal.ITIMER_PROF, SECONDS)  # ends the process: a hang
            result = outcome(path, units, (repr(arrays), said))
            signal.setitimer(signal.ITIMER_PROF, 0.0)
            pipe.send(result)


def outcomes(name: str, seeds: range) -> list[tuple[str, int, str]]:
    """Mutation, place and outcome of every mutant of a format; a process that ends is replaced."""
    results: list[tuple[str, int, str]] = []
    while len(results) < len(seeds):
        begun, before = None, len(results)
        with safe_children():
            server = multiprocessing.get_context("forkserver")  # imports once, and forks here
            server.set_forkserver_preload(["benchmarks.mutants", *LOADED])
            ours, theirs = server.Pipe(duplex=False)
            own = (name, seeds.start, seeds.stop, len(results), theirs)
            child = server.Process(target=worker, args=own)
            child.start()
        theirs.close()
        with suppress(EOFError):  # the end of the process
            while True:
                content = ours.recv()
                if isinstance(content, tuple):
                    begun = content
                elif begun is not None:
                    results.append((*begun, content))
                    begun = None
        child.join()
        if begun is not None:
            hung = child.exitcode == -signal.SIGPROF
            result = "hang" if hung else f"crash, status {child.exitcode}"
            results.append((*begun, result))
        elif len(results) == before:
            raise DataError(f"the valid file of {name!r} cannot be read, expected a recording")
    return results


def main(
    reader: Annotated[str, typer.Option(help="Only the formats whose name contains this.")] = "",
    mutants: Annotated[int, typer.Option(min=1, help="Mutants of each format.")] = 1000,
    seed: Annotated[int, typer.Option(min=0, help="First seed.")] = 0,
    listed: Annotated[int, typer.Option(min=0, help="Silent mutants listed.")] = 0,
) -> None:
    """Print the number of each outcome by format, and crashes, hangs and silent mutants."""
    print(f"| format | {' | '.join(OUTCOMES)} |\n|---|{'---:|' * len(OUTCOMES)}")
    details: list[str] = []
    for name in formats():
        if reader.lower() not in name.lower():
            continue
        results = outcomes(name, range(seed, seed + mutants))
        count = Counter(result.split()[0].rstrip(",") for _, _, result in results)
        print(f"| {name} | {' | '.join(str(count[one]) for one in OUTCOMES)} |", flush=True)
        shown = Counter[str]()
        for k, (kind, at, result) in enumerate(results):
            shown[kind] += result == "silent"
            if result.startswith(("crash", "hang", "memory", "unlocated")) or (
                result == "silent" and shown[kind] <= listed
            ):
                details.append(f"{name}, seed {seed + k}: {kind} at byte {at}: {result}")
    print("\n".join(details))
