"""Workers that do runs: this process, processes on this machine, or a Dask cluster."""

from __future__ import annotations

import logging
import multiprocessing
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from experiments.errors import InputError
from experiments.extras import missing, needed, require
from experiments.threads import ONE_THREAD

if TYPE_CHECKING:
    from distributed import Client, LocalCluster

SELDOM = {
    "distributed.worker.profile.enabled": False,
    "distributed.worker.memory.monitor-interval": "500ms",
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "5s",
}
"""Settings of Dask's monitoring: with the default intervals it takes 12 % of a core, with these 1 %."""

DEATHS = 2
"""If DEATHS local workers die during a batch, each run of the batch is repeated alone. If DEATHS workers die during a
repeated run, this run has failed. Choice: one death may have an external cause."""

REACHED_S = 30.0
"""Timeout for connecting to a scheduler [s]."""

FEW_RUNS = 10
"""If a study has fewer runs than this, this process does all of them; choice: workers would take longer to start."""

NO_WORKER_S = 300.0
"""Time without workers after which a study on this machine ends [s]; a worker starts within some seconds."""


@dataclass(frozen=True, slots=True)
class Workers:
    """Where runs are done: in processes on this machine, or by the workers of a Dask scheduler.

    n_processes: number of processes on this machine; 1: this process alone; None: as many as cores
    scheduler: address of a Dask scheduler, `tcp://host:8786`; if stated, n_processes is not used
    """

    n_processes: int | None = None
    scheduler: str | None = None

    @property
    def own_process(self) -> bool:
        """Whether this process does the runs, without Dask."""
        return self.scheduler is None and self.n_processes == 1


OWN_PROCESS, ALL_CORES = Workers(n_processes=1), Workers()


def workers_for(n_runs: int, wanted: Workers) -> Workers:
    """The wanted workers. OWN_PROCESS replaces ALL_CORES if there are few runs or the extra `cluster` is missing."""
    if wanted != ALL_CORES:
        return wanted
    installed = missing("cluster") is None
    if n_runs >= FEW_RUNS and not installed:
        sys.stderr.write(f"softaim: one core is used; for all of them: {needed('cluster')}\n")
    return ALL_CORES if n_runs >= FEW_RUNS and installed else OWN_PROCESS


@contextmanager
def connected(workers: Workers, module: str) -> Iterator[Client]:
    """A Dask client of the workers for a `with` block. Raises InputError if `cluster` or the scheduler is missing.

    module: name of a module to import before local workers are forked, so that they start fast
    """
    require("--processes" if workers.scheduler is None else "--scheduler", "cluster")
    from distributed import Client

    if workers.scheduler is not None:
        try:
            client = Client(workers.scheduler, timeout=REACHED_S)
        except (OSError, ValueError) as error:
            reason = " ".join(str(error).split()) or type(error).__name__
            raise InputError.at(f"--scheduler {workers.scheduler}", "a Dask scheduler", reason) from error
        with client:
            yield client
        return
    with local_cluster(workers.n_processes, module) as cluster, Client(cluster) as client:
        yield client


@contextmanager
def local_cluster(n_processes: int | None, module: str) -> Iterator[LocalCluster]:
    """A cluster of workers on this machine, each with one thread; None: one per core. Dead workers are replaced."""
    import dask
    from dask.system import CPU_COUNT
    from distributed import LocalCluster

    method = "forkserver" if "forkserver" in multiprocessing.get_all_start_methods() else "spawn"
    settings = {
        "distributed.worker.multiprocessing-method": method,
        "distributed.nanny.pre-spawn-environ": ONE_THREAD,
        # Ctrl-C reaches all processes of a terminal; this process closes the others
        "distributed.worker.preload": ["import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)"],
        "distributed.scheduler.allowed-failures": DEATHS - 1,
        # a second batch that waits at a worker would count as failed if the worker died
        "distributed.scheduler.worker-saturation": 1.0,
        # on a busy machine a worker may take longer to return than the default timeout of 15 s
        "distributed.deploy.lost-worker-timeout": NO_WORKER_S,
        **SELDOM,
    }
    with dask.config.set(settings):
        if method == "forkserver":
            _start_forkserver(module)
        with LocalCluster(
            n_workers=CPU_COUNT if n_processes is None else n_processes,
            threads_per_worker=1,
            processes=True,
            dashboard_address="127.0.0.1:0",  # any free port
            silence_logs=logging.CRITICAL,
        ) as cluster:
            yield cluster


def _needed_by(module: str) -> list[str]:
    """Modules to import before workers are forked: `module`, or its imports if `module` is the main program."""
    main = sys.modules["__main__"]
    spec = getattr(main, "__spec__", None)
    if spec is None or spec.name != module:
        return [module]
    names = {getattr(value, "__module__", None) for value in vars(main).values()}
    return sorted(name for name in names if isinstance(name, str) and not name.startswith("__"))


def _start_forkserver(module: str) -> None:
    """Start a process that imports the modules of the workers, so that workers forked from it start fast."""
    from multiprocessing import forkserver

    from distributed.utils import get_mp_context

    context = get_mp_context()
    context.set_forkserver_preload(["distributed", *_needed_by(module)])
    before = dict(os.environ)
    os.environ.update({name: str(value) for name, value in ONE_THREAD.items() if name not in before})
    try:
        forkserver.ensure_running()
    finally:
        for name in ONE_THREAD.keys() - before.keys():
            del os.environ[name]
