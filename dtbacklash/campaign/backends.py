"""Who does the jobs of a campaign: this process, this machine's cores, Dask, a launcher of Hydra."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from dtbacklash.campaign.jobs import Job, perform
from dtbacklash.config.commands import BACKENDS
from dtbacklash.errors import UserError

#: one thread a worker: the workers themselves fill the cores
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class Workers:
    """Workers of joblib.

    backend : loky (processes here) or dask. jobs : how many at once; one of loky is this process itself.
    scheduler : address of a Dask scheduler that runs already; None starts one here.
    """

    backend: str = "loky"
    jobs: int = 2
    scheduler: str | None = None

    def do(self, jobs: Sequence[Job]) -> None:
        """Perform the jobs, in any order; raises what a worker died of, and :func:`workers`' errors."""
        if self.backend == "loky" and self.jobs == 1:
            for job in jobs:
                perform(job)
            return
        from joblib import Parallel, delayed

        with workers(self.backend, self.jobs, self.scheduler):
            for _ in Parallel(return_as="generator_unordered", batch_size=1)(delayed(perform)(job) for job in jobs):
                pass

    def alone(self) -> OwnProcess:
        """A process of its own on this machine."""
        return OwnProcess()


@dataclass(frozen=True)
class OwnProcess:
    """A new process for each job: joblib's own pool may still be ending with a worker that died."""

    def do(self, jobs: Sequence[Job]) -> None:
        """Perform the jobs, one after the other; raises what a process died of."""
        from joblib.externals.loky import ProcessPoolExecutor

        for job in jobs:
            with ProcessPoolExecutor(max_workers=1) as process:
                process.submit(perform, job).result()

    def alone(self) -> OwnProcess:
        """The same one."""
        return self


@dataclass(frozen=True)
class Launcher:
    """A launcher of Hydra, which calls the command's task with the composed configuration of each job.

    launch : its method of this name. words : what the command line of a job would be.
    """

    launch: Callable[..., Any]
    words: Callable[[Job], list[str]]

    def do(self, jobs: Sequence[Job]) -> None:
        """Have the jobs performed, in any order; raises what a worker died of."""
        for name in THREADS:
            os.environ.setdefault(name, "1")
        for answer in self.launch([self.words(job) for job in jobs], initial_job_idx=0) or ():
            error = getattr(answer, "_return_value", None)  # `return_value` would print several lines first
            if isinstance(error, Exception):
                raise error

    def alone(self) -> Launcher:
        """The same one."""
        return self


def check_backend(backend: str, scheduler: str | None) -> None:
    """Refuse a backend that is not known or not installed, before anything is written.

    Raises UserError: no such backend; its extra is not installed; a scheduler for a backend that has none.
    """
    if backend not in BACKENDS:
        raise UserError("backend", backend, "choose one of " + ", ".join(BACKENDS))
    if scheduler is not None and backend == "loky":
        raise UserError("scheduler", scheduler, "belongs to backend=dask")
    if backend == "dask":
        try:
            import distributed  # noqa: F401
        except ImportError:
            raise UserError("backend", backend, "is not installed; pip install 'dtbacklash[dask]'") from None


@contextmanager
def workers(backend: str, jobs: int, scheduler: str | None = None) -> Iterator[None]:
    """Let joblib's ``Parallel`` use ``jobs`` workers of a backend, each with one thread.

    scheduler : address of a Dask scheduler that runs already (its workers see the same folders and have this package);
        None starts a cluster of ``jobs`` workers here, for as long as the block lasts.

    Raises UserError: the backend is not installed, or no scheduler answers at the address.
    """
    check_backend(backend, scheduler)
    for name in THREADS:
        os.environ[name] = "1"
    if backend == "dask":
        with _dask(jobs, scheduler):
            yield
    else:
        from joblib import parallel_config

        with parallel_config("loky", n_jobs=jobs, inner_max_num_threads=1):
            yield


@contextmanager
def _dask(jobs: int, scheduler: str | None) -> Iterator[None]:
    from distributed import Client, LocalCluster
    from joblib import parallel_config

    if scheduler is not None:
        try:
            client = Client(scheduler, timeout=20)
        except (OSError, ValueError, TimeoutError):
            raise UserError("scheduler", scheduler, "no Dask scheduler answers there") from None
        with client, parallel_config("dask"):
            yield
        return
    with (
        LocalCluster(
            n_workers=jobs, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs="ERROR"
        ) as cluster,
        Client(cluster),
        parallel_config("dask"),
    ):
        yield
