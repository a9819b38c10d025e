"""Rows of a study on Dask's workers: processes of this machine, or of many.

A worker that dies takes nothing along but the rows it was measuring, and Dask gives these to
another. Workers have to run the same software as this process, or their verdicts would not be the
same; of processors it is told which ones there were, as times from different ones do not compare.
They need Dask, which is in the extra `cluster`.
"""

from __future__ import annotations

import contextlib
import functools
import importlib.util
import logging
import pickle
import signal
import threading
import uuid
import zlib
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import CancelledError
from typing import Any

from armguard.exceptions import ArmguardError
from armguard.lab.rows import MACHINE, Measure, Row, name_machine
from armguard.recording.provenance import describe_software

LOCAL = "local"
"""Address that asks for a cluster on this machine."""

SOFTWARE = ("armguard", "sources", "numba", "llvmlite", "numpy", "pinocchio", "python")
"""What must be the same on all workers."""

KEPT = "what was measured is kept; --resume goes on with it"
"""What there is to be done where a study had to end."""

PATIENCE = 30.0
"""For a scheduler to answer, in [s]."""

MISTAKE = "mistake"
"""Field of a row that is added: what it failed by."""

_ALONE = threading.Lock()
"""Held while a row is measured: a process that measures two at once would time neither."""


class Cluster:
    """Dask's workers.

    Args:
        address: Of a scheduler, or `LOCAL`: a scheduler and workers are started, and end with this.
        workers: How many are started here; None: one for each processor.

    Attributes:
        client: Dask's.

    Raises:
        ArmguardError: Dask is not installed, the address is none, or nothing answers there.
    """

    def __init__(self, address: str, workers: int | None = None) -> None:
        if importlib.util.find_spec("distributed") is None:
            raise ArmguardError(
                "--dask",
                "needs Dask, which is not installed",
                remedy='pip install "armguard[cluster]"',
            )
        from distributed import Client, LocalCluster

        if workers is not None and address != LOCAL:
            raise ArmguardError(
                "--workers", "goes with a cluster on this machine", expected=f"--dask {LOCAL}"
            )
        if workers is not None and not workers >= 1:
            raise ArmguardError("--workers", f"is {workers}", expected="1 or more")
        if address != LOCAL:
            _check_address(address)
        # What the client says of a lost scheduler is told as one error.
        logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
        self._closing = contextlib.ExitStack()
        if address == LOCAL:
            # One thread each, as a row is timed; no limit at which Dask would kill a worker.
            cluster = LocalCluster(
                n_workers=workers, threads_per_worker=1, processes=True, memory_limit=0,
                dashboard_address="127.0.0.1:0", scheduler_kwargs={"dashboard": False},
                silence_logs=logging.CRITICAL, preload=[__name__],
            )  # fmt: skip
            self._closing.enter_context(cluster)
            address = cluster.scheduler_address
        try:
            self.client = Client(address, timeout=PATIENCE, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            self._closing.close()
            raise ArmguardError(
                "--dask", f"no scheduler answers at {address!r} ({error})",
                remedy=f"start one with `dask scheduler`, or say --dask {LOCAL}",
            ) from None  # fmt: skip
        self._closing.callback(self.client.close)

    def __enter__(self) -> Cluster:
        return self

    def __exit__(self, *why: object) -> None:
        self.close()

    def close(self) -> None:
        """Leave the workers; those that were started here end."""
        self._closing.close()

    def run(
        self, measure: Measure, shared: Any, tasks: Mapping[str, tuple[Any, ...]]
    ) -> Iterator[tuple[str, Row]]:
        """Measure all, and hand over each row as it comes.

        Raises:
            ArmguardError: A worker's software differs, a row took several workers down, or the
            scheduler is gone.
        """
        from distributed import KilledWorker, as_completed

        software = {name: describe_software()[name] for name in SOFTWARE}
        token = uuid.uuid4().hex
        # A task of its own rather than scattered data: what a dead worker held is made again.
        common = self.client.submit(
            _unpack, zlib.compress(pickle.dumps(shared), 1), key=f"armguard-{token}", pure=False
        )
        names = {
            self.client.submit(
                _measure, measure, common, arguments, software,
                key=f"armguard-{token}-{number}", pure=False,
            ): name
            for number, (name, arguments) in enumerate(tasks.items())
        }  # fmt: skip
        try:
            for future in as_completed(list(names), loop=self.client.loop):
                try:
                    row: Row = future.result()
                except CancelledError:
                    raise ArmguardError(
                        "--dask", "the scheduler is gone", remedy=f"{KEPT} with another"
                    ) from None
                except KilledWorker:
                    raise ArmguardError(
                        f"row {names[future]!r}",
                        "took several workers down, one after the other",
                        remedy=KEPT,
                    ) from None
                if MISTAKE in row:
                    raise ArmguardError(row[MACHINE], row[MISTAKE])
                yield names[future], row
        finally:
            self.client.cancel([*names, common])


def _check_address(address: str) -> None:
    """Make sure that Dask can ask there at all; else its client would go on trying.

    Raises:
        ArmguardError: The protocol is unknown or not installed, or there is no port.
    """
    from distributed.comm.addressing import parse_address
    from distributed.comm.registry import get_backend

    try:
        scheme, place = parse_address(address)
        backend = get_backend(scheme)
        backend.get_connector()
        backend.get_address_host(place)
    except (ValueError, ImportError, TypeError) as error:
        raise ArmguardError(
            "--dask", f"no scheduler answers at {address!r} ({error})",
            expected="an address such as tcp://10.0.0.5:8786",
        ) from None  # fmt: skip


def dask_setup(worker: object) -> None:
    """Called by Dask in workers that are started here, since they preload this module.

    Ctrl-C reaches all processes of a terminal; it is for the one that holds the study, which ends
    its workers.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _unpack(content: bytes) -> Any:
    return pickle.loads(zlib.decompress(content))


def _measure(
    measure: Callable[..., Row], shared: Any, arguments: tuple[Any, ...], software: dict[str, str]
) -> Row:
    """On a worker: measure a row, if the software is the same."""
    here = _describe_here()
    machine = name_machine()
    for name, wanted in software.items():
        if here[name] != wanted:
            return {
                MACHINE: f"worker on {machine}",
                MISTAKE: f"has another {name}: {here[name]}; the study was started with {wanted}",
            }
    with _ALONE:
        try:
            return {**measure(shared, *arguments), MACHINE: machine}
        except ArmguardError as error:
            return {MACHINE: f"worker on {machine}", MISTAKE: str(error)}


@functools.cache
def _describe_here() -> dict[str, str]:
    return describe_software()
