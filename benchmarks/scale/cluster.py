"""A dask.distributed scheduler and workers, started as commands on this machine."""

import subprocess
from pathlib import Path

from emgface.children import child_environment, python_command


class StartedByHand:
    """A dask scheduler and workers, started as commands."""

    def __init__(self, folder: Path, workers: int, port: int = 18786, nanny: bool = True) -> None:
        self.address, self._folder = f"tcp://127.0.0.1:{port}", folder
        self._count, self._nanny, self._port = workers, nanny, port
        self.scheduler: subprocess.Popen[bytes] | None = None
        self.workers: list[subprocess.Popen[bytes]] = []

    def start_scheduler(self) -> None:
        """Start the scheduler."""
        command = ["scheduler", "--port", str(self._port), "--no-dashboard", "--no-show"]
        self.scheduler = self._start(command)

    def start_worker(self) -> None:
        """Start one worker of one thread."""
        command = ["worker", self.address, "--nthreads", "1", "--no-dashboard"]
        self.workers.append(self._start(command if self._nanny else [*command, "--no-nanny"]))

    def _start(self, arguments: list[str]) -> subprocess.Popen[bytes]:
        self._folder.mkdir(parents=True, exist_ok=True)
        with (self._folder / "dask.log").open("ab") as log:
            command = python_command("-m", "dask", *arguments)
            return subprocess.Popen(command, stdout=log, stderr=log, env=child_environment())

    def __enter__(self) -> "StartedByHand":  # noqa: D105
        self.start_scheduler()
        for _ in range(self._count):
            self.start_worker()
        return self

    def __exit__(self, *_: object) -> None:  # noqa: D105
        for process in (*self.workers, self.scheduler):
            if process is not None:
                process.terminate()
        for process in (*self.workers, self.scheduler):
            if process is not None:
                try:
                    process.wait(timeout=20)
                except subprocess.TimeoutExpired:
                    process.kill()
