"""Calls of compiled parsers in a child process with limits of memory and time.

Compiled parsers of binary formats may terminate their process if a file is damaged: a segmentation
fault cannot be caught. Such a parser therefore runs in a child process, which is started at the
first call, serves all later calls, and is restarted after a crash.

A damaged file could also let the child send anything. Both processes therefore exchange only plain
values and arrays, as JSON and bytes (`emgface.recordings.readers._messages`), and an error is
one of known types.
"""

import atexit
import os
import signal
import subprocess
import sys
import threading
import warnings
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from emgface.children import child_environment, python_command
from emgface.errors import DataError
from emgface.recordings.readers._messages import (
    DamagedMessage,
    error_of,
    function_of,
    name_of,
    packed_error,
    receive,
    send,
)
from emgface.recordings.readers._parsers import AbsentVariable, NotAnArray

P = ParamSpec("P")
T = TypeVar("T")

_MEMORY, _MEMORY_PER_BYTE = 2 << 30, 64
"""Limit of the address space of a parser [byte], and addition per byte of the file."""
_SECONDS, _SECONDS_PER_BYTE = 60.0, 2e-6
"""Limit of the run time of a parser [s], and addition per byte of the file."""
_START = "from emgface.recordings.readers._isolated import serve; serve()"


def isolated(path: Path, function: Callable[P, T], /, *arguments: P.args, **options: P.kwargs) -> T:
    """Call a function of a module in the child process, and return its result.

    Arguments and result are plain values and arrays. The size of the file `path` determines the
    limits, and its name is stated in messages. Raises DataError if the child process ended, exceeded
    a limit or answered with something else, and any exception of the function.
    """
    with _LOCK:
        child = _running()
        size = path.stat().st_size if path.is_file() else 0
        limit = _SECONDS + _SECONDS_PER_BYTE * size
        late = threading.Event()

        def stop() -> None:
            late.set()
            child.kill()

        timer = threading.Timer(limit, stop)
        timer.start()
        try:
            send(child.stdin, [name_of(function), list(arguments), options, size])
            succeeded, result = _answer(receive(child.stdout))
        except (EOFError, OSError, DamagedMessage) as problem:
            _end(child)
            if isinstance(problem, DamagedMessage):
                raise DataError(
                    f"{path.name} cannot be read: its parser returned {problem}; expected a complete "
                    "file: it is damaged, copy or export it again."
                ) from None
            why = f"took longer than {limit:.0f} s" if late.is_set() else _how(child.returncode)
            raise DataError(
                f"{path.name} cannot be read: its parser {why}; expected a complete file: it is "
                "truncated or damaged, copy or export it again."
            ) from None
        except BaseException:  # after an interruption the pipe contains an incomplete answer
            _end(child)
            raise
        finally:
            timer.cancel()
    if not succeeded:
        raise error_of(result)
    return result


def _answer(message: Any) -> tuple[bool, Any]:
    """Success and result of an answer of the child process."""
    if not (isinstance(message, list) and len(message) == 2 and isinstance(message[0], bool)):
        raise DamagedMessage("no answer")
    return message[0], message[1]


def parsed(path: Path, function: Callable[P, T], /, *arguments: P.args, **options: P.kwargs) -> T:
    """Call a parser as `isolated`; a file at which it fails in any way is damaged.

    Raises DataError, and AbsentVariable or NotAnArray for a whole file.
    """
    from emgface.schema.rules import one_line  # the child process does not need xarray

    try:
        return isolated(path, function, *arguments, **options)
    except (DataError, AbsentVariable, NotAnArray):
        raise
    except Exception as error:  # parsers may raise any exception for a damaged file
        raise DataError(
            f"{path.name} cannot be read ({one_line(error)}); expected a complete file: it is "
            "damaged or of another format, copy or export it again."
        ) from error


_LOCK = threading.Lock()
_children: dict[int, "subprocess.Popen[bytes]"] = {}
"""Child process by the process that started it, because a fork does not inherit it."""


def _running() -> "subprocess.Popen[bytes]":
    """Return the child process of this process, starting it if necessary."""
    own = os.getpid()
    child = _children.get(own)
    if child is None or child.poll() is not None:
        child = _children[own] = subprocess.Popen(
            python_command("-c", _START),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=child_environment(),
        )
        atexit.register(_end, child)
    return child


def _end(child: "subprocess.Popen[bytes]") -> None:
    atexit.unregister(_end)
    child.kill()
    child.wait()
    for stream in (child.stdin, child.stdout):
        with suppress(OSError):
            if stream is not None:
                stream.close()


def _how(code: int | None) -> str:
    """Describe the exit of a process."""
    if code is not None and code < 0:
        with suppress(ValueError):
            return f"crashed ({signal.Signals(-code).name})"
    return f"ended with the exit code {code}"


def serve() -> None:
    """Answer calls from standard input until it is closed; the main function of the child."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent handles interruptions
    requests, answers = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # the output of parsers must not enter the pipe
    # A parser that doubts what it reads, such as data in a byte order it does not know, has failed.
    warnings.simplefilter("error", UserWarning)
    while True:
        try:
            name, arguments, options, size = receive(requests)
        except EOFError:
            return
        _limit_memory(size)
        try:
            answer = [True, function_of(name)(*arguments, **options)]
        except Exception as error:
            answer = [False, packed_error(error)]
        try:
            try:
                send(answers, answer)
            except (TypeError, MemoryError) as error:  # a result that is not plain, or too large
                send(answers, [False, packed_error(error)])
        except BrokenPipeError:
            return


def _limit_memory(size: int) -> None:
    """Limit the address space, if the platform supports it."""
    try:
        import resource

        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    except (ImportError, OSError):
        return
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    wanted = used + _MEMORY + _MEMORY_PER_BYTE * size
    allowed = wanted if hard == resource.RLIM_INFINITY else min(wanted, hard)
    resource.setrlimit(resource.RLIMIT_AS, (allowed, hard))
    resource.setrlimit(resource.RLIMIT_CORE, (0, resource.getrlimit(resource.RLIMIT_CORE)[1]))
