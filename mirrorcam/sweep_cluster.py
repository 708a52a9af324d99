"""Designs on a Dask cluster: its scheduler gives those of a lost worker to another; results come to this machine."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence

from mirrorcam.extras import require
from mirrorcam.sweep_local import Died, in_order
from mirrorcam.sweep_work import Answer, Work, answer
from optics.spec import DesignSpec
from optics.values import InputError

SECONDS_TO_CONNECT = 10


def run_cluster(specs: Sequence[DesignSpec], address: str, work: Work = answer) -> Iterator[tuple[int, Answer | Died]]:
    """Number and answer of each spec, as they come, from the workers of the scheduler at `address`.

    Workers may come and go. Raises InputError where no scheduler answers, or where it goes away.
    """
    require("cluster")
    from distributed import Client, Future, KilledWorker, as_completed

    for name in ("distributed", "distributed.client"):
        logging.getLogger(name).setLevel(logging.CRITICAL)  # what goes wrong is said here, in one line
    try:
        client = Client(address, timeout=SECONDS_TO_CONNECT, set_as_default=False)
    except (OSError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"--scheduler {address}: no Dask scheduler answers there: {reason}") from None
    with client:
        order = [number for group in in_order(specs) for number in group]
        futures: dict[Future[Answer], int] = dict(
            zip(client.map(work, [specs[number].model_dump_json() for number in order], pure=False), order, strict=True)
        )
        try:
            for future in as_completed(futures, loop=client.loop):
                if future.cancelled():
                    raise InputError(f"--scheduler {address}: the connection to the scheduler was lost")
                try:
                    got: Answer | Died = future.result()
                except KilledWorker as killed:
                    got = Died(f"{killed.allowed_failures + 1} workers died of it")
                yield futures[future], got
                future.release()
        finally:
            client.cancel(list(futures))
