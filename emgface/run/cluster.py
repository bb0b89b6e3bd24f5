"""Execution of jobs by the workers of a dask.distributed scheduler.

The scheduler transports jobs and records of a few kilobytes; data are read from and written to the
store, which lies on a file system shared by all workers. dask.distributed retries a job whose
worker died (setting ``distributed.scheduler.allowed-failures``, three by default).
"""

import ipaddress
import json
import logging
import time
import warnings
from collections.abc import Callable
from concurrent.futures import CancelledError, Future
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from emgface.errors import ConfigurationError, ExecutionError, WorkerDied

SCHEDULER_TIMEOUT: Final = 30.0  #: seconds to wait for a scheduler to answer
REFRESH: Final = 2.0  #: seconds between two counts of the workers
AHEAD: Final = 2
"""Jobs submitted per thread of the workers, so that no worker waits for the next one."""


class DaskWorkers:
    """Workers of a dask.distributed scheduler, which may join and leave during a run.

    `address` is that of the scheduler, such as ``tcp://host:8786``, or the file to which it writes it
    (``dask scheduler --scheduler-file``). Raises ConfigurationError if the package distributed is not
    installed or the file does not contain an address, and ExecutionError if no scheduler answers.
    """

    tries = 1

    def __init__(self, address: str, timeout: float = SCHEDULER_TIMEOUT) -> None:
        try:
            from distributed import Client  # pyright: ignore[reportMissingImports]
        except ImportError as error:
            raise ConfigurationError(
                "a scheduler requires the package distributed, which is not installed: install "
                "'emgface[distributed]', or use --workers without --scheduler"
            ) from error
        self.address = address if "://" in address else _address_in(Path(address))
        try:
            self._client: Any = Client(self.address, timeout=timeout, set_as_default=False)
        except (OSError, ValueError) as error:  # a timeout is an OSError
            raise ExecutionError(
                f"no scheduler answers at {self.address} ({error}): start one with 'dask scheduler', or "
                "correct the address"
            ) from error
        if problem := open_port(self.address):
            warnings.warn(problem, stacklevel=2)
        self._executor = self._client.get_executor(pure=False)
        self._counted, self._threads, self._reported = -REFRESH, 0, False

    @property
    def threads(self) -> int:
        """Number of threads of all workers, counted every few seconds."""
        if time.monotonic() - self._counted >= REFRESH:
            try:
                self._threads = sum(self._client.nthreads().values())
            except Exception as error:  # the connection has many ways to be closed
                raise self._lost() from error
            self._counted = time.monotonic()
            if not (self._threads or self._reported):
                warnings.warn(
                    f"the scheduler at {self.address} has no workers: jobs wait until one joins, for "
                    f"example by 'dask worker {self.address} --nthreads 1'",
                    stacklevel=2,
                )
            self._reported = not self._threads
        return self._threads

    @property
    def slots(self) -> int:
        """Jobs to submit: some for each thread, one for a worker that is still to come."""
        return max(1, AHEAD * self.threads)

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Give a job to the scheduler."""
        try:
            return self._executor.submit(function, *arguments)
        except Exception as error:
            raise self._lost() from error

    def result(self, future: Future[Any]) -> Any:
        """Return the result of a job, or raise its error."""
        from distributed import KilledWorker  # pyright: ignore[reportMissingImports]

        try:
            return future.result()
        except KilledWorker as error:
            raise WorkerDied(
                f"{error.allowed_failures + 1} workers died while they computed it (killed, or "
                "out of memory): give the workers more memory, or use a coarser face"
            ) from error
        except CancelledError as error:
            raise self._lost() from error

    def _lost(self) -> ExecutionError:
        return ExecutionError(
            f"the scheduler at {self.address} does not answer any more: completed results are "
            "stored; start it again and run the same command to continue"
        )

    def stop(self) -> None:
        """Cancel all jobs that have not begun; a job that runs ends with its result stored."""
        with suppress(Exception):  # the scheduler may have gone
            self._executor.shutdown(wait=False)
            self._executor = self._client.get_executor(pure=False)

    def end(self) -> None:
        """Disconnect from the scheduler."""
        # A client that is closed while it tries to connect again logs a traceback.
        logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
        with suppress(Exception):
            self._client.close(timeout=5)


def open_port(address: str) -> str:
    """Warning about a scheduler that other machines can reach and anybody may use; or an empty text.

    Whoever reaches the port of a scheduler can execute code on it and on its workers, unless the
    connection is authenticated (tls) or restricted to this machine (inproc, or its own address).
    """
    protocol, _, rest = address.partition("://")
    host = rest.rpartition(":")[0].strip("[]")
    try:
        local = ipaddress.ip_address(host).is_loopback
    except ValueError:
        local = host == "localhost"
    if protocol in ("inproc", "tls", "wss") or local:
        return ""
    return (
        f"the scheduler at {address} is not authenticated: everybody who reaches its port can "
        "execute code on it and its workers, with your rights. Use a private network and a "
        "firewall, or certificates (tls://, 'dask scheduler --tls-ca-file ...')"
    )


def _address_in(file: Path) -> str:
    """Address in the file of a scheduler."""
    try:
        return str(json.loads(file.read_text(encoding="utf-8"))["address"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ConfigurationError(
            f"{file} contains no address of a scheduler ({error}), expected tcp://host:8786 or the file "
            "of 'dask scheduler --scheduler-file'"
        ) from error
