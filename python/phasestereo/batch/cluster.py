"""The processes that match: those of a cluster that is there already, or some of this machine."""

from __future__ import annotations

import gc
import logging
import os
from contextlib import ExitStack, contextmanager
from multiprocessing import resource_tracker
from typing import TYPE_CHECKING, Any

import phasestereo
from phasestereo._extras import require
from phasestereo._interrupts import unheard
from phasestereo.batch.work import version

if TYPE_CHECKING:
    from collections.abc import Iterator

_FIRST_WORKER = 60  # seconds until one must have come: those of a batch system take a while


def share(workers: int | None, threads: int | None, pairs: int) -> tuple[int, int]:
    """Return how many processes of this machine match, and on how many threads each.

    All processors are used, none twice: one process a processor, fewer if there are fewer pairs, or
    as many as are wanted; each with its part of the processors.
    """
    processors = require("dask.system", extra="dask").CPU_COUNT
    if workers is None:
        workers = max(1, min(pairs, processors // (threads or 1)))
    return workers, threads or max(1, processors // workers)


@contextmanager
def local(workers: int) -> Iterator[Any]:
    """Start processes on this machine; yield a client of them, and end them with the block.

    Raises
    ------
    ImportError
        If Dask's scheduler is not installed.
    """
    distributed, dask = require("distributed", extra="dask"), require("dask", extra="dask")
    options = {
        "n_workers": workers,
        "threads_per_worker": 1,
        "processes": True,
        "dashboard_address": "127.0.0.1:0",  # at the usual port there may be one of another run
        "silence_logs": logging.CRITICAL,  # that workers die is told in the manifest
    }
    environment = dask.config.get("distributed.nanny.pre-spawn-environ")
    changes = {
        # A pair whose worker died comes back at once: who is to blame is found out here.
        "distributed.scheduler.allowed-failures": 0,
        # Nobody looks at the statistics of what Python is at: it waits for the core.
        "distributed.worker.profile.enabled": False,
        # Workers would hand back memory that the next match asks for again, a fifth of its time.
        "distributed.nanny.pre-spawn-environ": {
            name: value for name, value in environment.items() if not name.startswith("MALLOC_")
        },
    }
    if os.name == "posix":
        resource_tracker.ensure_running()  # the thread that starts it would hear Ctrl-C again
    with ExitStack() as stack:
        # Ctrl-C is meant for the run, which ends the workers.
        with dask.config.set(changes), unheard():
            cluster = stack.enter_context(distributed.LocalCluster(**options))
        yield stack.enter_context(distributed.Client(cluster, set_as_default=False))


@contextmanager
def remote(address: str) -> Iterator[Any]:
    """Connect to a cluster; yield a client.

    Raises
    ------
    OSError
        If there is no scheduler, or no worker comes.
    ValueError
        If the address is none, or a worker has another version of this package, or none.
    ImportError
        If Dask's scheduler is not installed.
    """
    with _without_logs(), _connected(address) as client:
        try:
            client.wait_for_workers(1, timeout=_FIRST_WORKER)
        except TimeoutError as error:
            raise ConnectionError(f"{address} has no workers") from error
        _check_versions(client)
        yield client


@contextmanager
def _without_logs() -> Iterator[None]:
    """Keep Dask's client from telling at length, with tracebacks, of what is raised anyway."""
    logger = logging.getLogger("distributed.client")
    before, logger.disabled = logger.disabled, True
    try:
        yield
    finally:
        logger.disabled = before


def _connected(address: str) -> Any:
    distributed = require("distributed", extra="dask")
    try:
        return distributed.Client(address, set_as_default=False)
    except OSError as error:
        refusal: Exception = ConnectionError(f"no scheduler at {address}: {error}")
    except (ValueError, TypeError) as error:
        refusal = ValueError(
            f"scheduler: got {address!r}; accepts an address such as tcp://host:8786: {error}"
        )
    # A client that has failed is closed when it is collected. If the thread of a later client
    # happens to do that, the two wait for each other.
    gc.collect()
    raise refusal


def slots(client: Any) -> int:
    """Return how many pairs the workers match at the same time.

    Raises
    ------
    OSError
        If the scheduler is lost.
    """
    try:
        threads: dict[str, int] = client.nthreads()
    except OSError as error:
        raise lost(error) from error
    return max(1, sum(threads.values()))  # there is none while the last one is started again


def lost(error: Exception) -> ConnectionError:
    """Return what to raise when a scheduler does not answer any more."""
    return ConnectionError(
        f"the scheduler is lost; the same run again does what is missing ({error})"
    )


def _check_versions(client: Any) -> None:
    for address, found in client.run(version, on_error="return").items():
        if found != phasestereo.__version__:
            told = f"({found!r})" if isinstance(found, Exception) else found
            raise ValueError(
                f"scheduler: worker {address} has phasestereo {told}; accepts "
                f"{phasestereo.__version__}, as here"
            )
