"""Tasks on a Dask cluster, whose scheduler reassigns the tasks of a lost worker."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence

from mirrorcam.core.errors import InputError
from mirrorcam.core.extras import require
from mirrorcam.core.processes.worker_pool import Answer, Died, Work

SECONDS_TO_CONNECT = 10


def run_cluster(tasks: Sequence[str], address: str, work: Work[str, Answer]) -> Iterator[tuple[int, Answer | Died]]:
    """Yield index and answer of each task as workers of the scheduler at `address` finish it.

    Tasks start in order. Workers may join and leave. Raises InputError if no scheduler answers, or if the connection is
    lost.
    """
    require("cluster")
    from distributed import Client, Future, KilledWorker, as_completed
    from distributed.comm.core import CommClosedError

    for name in ("distributed", "distributed.client"):
        logging.getLogger(name).setLevel(logging.CRITICAL)  # errors are reported in one line
    try:
        client = Client(address, timeout=SECONDS_TO_CONNECT, set_as_default=False)
    except (OSError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"--scheduler {address}: no Dask scheduler answers there: {reason}") from None
    with client:
        submitted = client.map(work, list(tasks), pure=False)
        futures: dict[Future[Answer], int] = {future: number for number, future in enumerate(submitted)}
        lost = InputError(f"--scheduler {address}: the connection to the scheduler was lost")
        try:
            for future in as_completed(futures, loop=client.loop):
                if future.cancelled():
                    raise lost
                try:
                    answer: Answer | Died = future.result()
                except KilledWorker as killed:
                    answer = Died(f"{killed.allowed_failures + 1} workers died of it")
                except CommClosedError:
                    raise lost from None
                yield futures[future], answer
                future.release()
        finally:
            client.cancel(list(futures))
