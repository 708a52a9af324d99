"""A sweep on a Dask cluster of this machine: the same designs, whatever becomes of a worker."""

from __future__ import annotations

import signal
import subprocess
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

import pytest

from mirrorcam import cli
from mirrorcam.core.disk.output_folder import HIDDEN, results_folder
from mirrorcam.core.errors import InputError
from mirrorcam.core.processes.cluster import run_cluster
from mirrorcam.core.processes.worker_pool import Died
from mirrorcam.designs.design_sweep import Answer
from mirrorcam.designs.sweep_files import design_locally, design_on_cluster
from mirrorcam.optics.design.spec_grid import grid
from mirrorcam.optics.geometry.design_spec import DesignSpec
from tests.designs.made_up_designs import sweep_into

pytest.importorskip("distributed", reason="a cluster needs the extra cluster")
SPECS = grid(
    DesignSpec(),
    counts=[(1, 2), (2, 1)],
    depth_sets_mm=[(300.0, 500.0)],
    scales_mm=[80.0],
    tradeoffs=[0.3, 0.5, 0.6],
)


def files_of(folder: Path) -> dict[str, bytes]:
    files = {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    return {name: content for name, content in files.items() if not name.startswith(HIDDEN)}


def test_a_missing_scheduler_is_reported_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("mirrorcam.core.processes.cluster.SECONDS_TO_CONNECT", 0.5)
    assert cli.main(["sweep", "--scheduler", "tcp://127.0.0.1:9", "--out", str(tmp_path / "out")]) == 2
    said = capfd.readouterr().err
    assert said.startswith("mirrorcam: --scheduler tcp://127.0.0.1:9: no Dask scheduler answers there: ")
    assert said.count("\n") == 1


@pytest.mark.slow
def test_a_killed_worker_costs_no_design(cluster: tuple[str, list[subprocess.Popen[bytes]]], tmp_path: Path) -> None:
    address, (_, first, _) = cluster
    yielded = 0

    def with_a_kill(specs: Sequence[DesignSpec]) -> Iterator[tuple[int, Answer | Died]]:
        nonlocal yielded
        for number, got in design_on_cluster(specs, address):
            if yielded == 0:
                first.send_signal(signal.SIGKILL)
            yielded += 1
            yield number, got
            assert len(list(results_folder(tmp_path / "cluster").iterdir())) == yielded

    outcomes = sweep_into(SPECS, tmp_path / "cluster", with_a_kill)
    assert first.wait(timeout=10) == -signal.SIGKILL
    assert [outcome.status for outcome in outcomes] == ["solved"] * len(SPECS)
    assert outcomes == sweep_into(SPECS, tmp_path / "local", partial(design_locally, workers=2))
    assert files_of(tmp_path / "cluster") == files_of(tmp_path / "local")


def test_a_connection_lost_while_an_answer_is_read_is_named_in_one_line(
    cluster: tuple[str, list[subprocess.Popen[bytes]]], monkeypatch: pytest.MonkeyPatch
) -> None:
    import distributed
    from distributed.comm.core import CommClosedError

    def reset(future: object) -> None:
        raise CommClosedError("in <TCP>: ConnectionResetError: [Errno 104] Connection reset by peer")

    monkeypatch.setattr(distributed.Future, "result", reset)
    with pytest.raises(InputError, match=r"^--scheduler tcp://.*: the connection to the scheduler was lost$"):
        list(run_cluster(["1"], cluster[0], str))


@pytest.mark.slow
def test_a_lost_scheduler_keeps_what_is_finished(
    cluster: tuple[str, list[subprocess.Popen[bytes]]], tmp_path: Path
) -> None:
    address, processes = cluster

    def until_lost(specs: Sequence[DesignSpec]) -> Iterator[tuple[int, Answer | Died]]:
        for number, got in design_on_cluster(specs, address):
            yield number, got
            for process in processes:
                process.kill()

    with pytest.raises(InputError, match="the connection to the scheduler was lost"):
        sweep_into(SPECS, tmp_path, until_lost)
    kept = files_of(tmp_path)
    assert kept
    asked: list[DesignSpec] = []

    def noting(specs: Sequence[DesignSpec]) -> Iterator[tuple[int, Answer | Died]]:
        asked.extend(specs)
        yield from design_locally(specs, 2)

    sweep_into(SPECS, tmp_path, noting)
    assert len(asked) + len([name for name in kept if name.startswith("layouts/")]) == len(SPECS)
