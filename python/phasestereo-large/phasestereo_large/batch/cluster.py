"""Use the workers of an existing Dask cluster as the processes that match."""

from __future__ import annotations

import gc
import logging
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

from phasestereo import _core
from phasestereo._extras import require
from phasestereo.io.files import StrPath, decoding, read_bounded
from phasestereo.io.limits import SMALL
from phasestereo_large.batch.work import FullDiskError, version
from phasestereo_large.processes import TaskResult, WorkerDiedError

_DIED = "its worker died: it ran out of memory, was killed, or crashed"
_PEM = b"-----BEGIN "
_FIRST_WORKER = 60  # seconds to wait for one: workers from a batch system take a while


def share(workers: int | None, threads: int | None, pairs: int) -> tuple[int, int]:
    """Return the number of matching processes on this machine, and the threads of each.

    They use every processor once: one process per processor, or fewer if there are fewer pairs, or
    the requested number; each gets its part of the processors.
    """
    processors = _core.Workers(None).count

    if workers is None:
        workers = max(1, min(pairs, processors // (threads or 1)))

    return workers, threads or max(1, processors // workers)


def encryption(ca: StrPath, cert: StrPath, key: StrPath) -> Any:
    """Return the encryption and mutual authentication for a connection to a cluster.

    Parameters
    ----------
    ca
        The certificates of the trusted authorities.
    cert, key
        This machine's certificate, and its key.

    Raises
    ------
    OSError
        If one of these files cannot be read.
    ValueError
        If one of them is not a PEM file.
    ImportError
        If Dask's scheduler is not installed.
    """
    for path in (ca, cert, key):
        with decoding(path) as file:
            if _PEM not in read_bounded(file, SMALL):
                raise ValueError("holds no certificate and no key: there is no BEGIN in it")
    return require("distributed", extra="dask").Security(
        tls_ca_file=os.fspath(ca),
        tls_client_cert=os.fspath(cert),
        tls_client_key=os.fspath(key),
        require_encryption=True,
    )


@contextmanager
def remote(address: str, security: Any = None) -> Iterator[Cluster]:
    """Connect to a cluster.

    Parameters
    ----------
    address
        The address of its scheduler.
    security
        The result of `encryption`; None: as in Dask's configuration.

    Raises
    ------
    OSError
        If no scheduler answers, or no worker comes.
    ValueError
        If the address is invalid, or a worker has another version of this package, or does not have
        it.
    ImportError
        If Dask's scheduler is not installed.
    """
    with _without_logs(), _connected(address, security) as client:
        try:
            client.wait_for_workers(1, timeout=_FIRST_WORKER)
        except TimeoutError as error:
            raise ConnectionError(f"{address} has no workers") from error
        _check_versions(client)
        yield Cluster(client)


@contextmanager
def _without_logs() -> Iterator[None]:
    """Keep Dask's client from logging errors with tracebacks; we raise them anyway."""
    logger = logging.getLogger("distributed.client")
    before, logger.disabled = logger.disabled, True
    try:
        yield
    finally:
        logger.disabled = before


def _connected(address: str, security: Any) -> Any:
    distributed = require("distributed", extra="dask")
    try:
        return distributed.Client(address, security=security, set_as_default=False)
    except OSError as error:
        refusal: Exception = ConnectionError(f"no scheduler at {address}: {error}")
    except (ValueError, TypeError) as error:
        refusal = ValueError(
            f"scheduler: got {address!r}; accepts an address such as tcp://host:8786: {error}"
        )

    # The garbage collector closes a client that failed. If it does so in the thread of a later
    # client, the two wait for each other.
    gc.collect()
    raise refusal


class Cluster:
    """The workers of a cluster; see `remote`."""

    def __init__(self, client: Any) -> None:
        distributed = require("distributed", extra="dask")
        self._client = client
        self._ended = distributed.as_completed(loop=client.loop)
        # The exceptions that show how a task ended.
        self._died = require("distributed.scheduler", extra="dask").KilledWorker
        self._cancelled = distributed.CancelledError

    def slots(self) -> int:
        """Return the number of tasks done at the same time.

        Raises
        ------
        OSError
            If the scheduler is lost.
        """
        try:
            threads: dict[str, int] = self._client.nthreads()
        except OSError as error:
            raise _lost(error) from error
        return max(1, sum(threads.values()))  # zero while the last worker restarts

    def submit(self, key: str, function: Callable[..., Any], *arguments: Any) -> None:
        """Have a worker call a function; every task needs its own key."""
        self._ended.add(self._client.submit(function, *arguments, key=key, retries=0))

    def finished(self) -> tuple[str, TaskResult]:
        """Wait for a task to end; return its key, and a function that returns or raises its result.

        The function raises `WorkerDiedError` if its worker died, and `ConnectionError` if the
        scheduler is lost.
        """
        future = next(self._ended)
        return future.key, partial(self._result, future)

    def _result(self, future: Any) -> Any:
        try:
            return future.result()
        except self._died as error:
            raise WorkerDiedError(_DIED) from error
        except FullDiskError:
            raise
        except (self._cancelled, OSError) as error:
            raise _lost(error) from error


def _lost(error: Exception) -> ConnectionError:
    """Return the error for a scheduler that stopped answering."""
    return ConnectionError(
        f"the scheduler is lost; the same run again does what is missing ({error})"
    )


def _check_versions(client: Any) -> None:
    for address, found in client.run(version, on_error="return").items():
        if found != _core.__version__:
            has = f"({found!r})" if isinstance(found, Exception) else found
            raise ValueError(
                f"scheduler: worker {address} has phasestereo {has}; accepts "
                f"{_core.__version__}, as here"
            )
