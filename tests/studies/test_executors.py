"""The same work by processes, by a thread, at once and by a Dask cluster: same results, none lost."""

from __future__ import annotations

import errno
import functools
import os
import pickle
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from inline_executor import quiet
from mortal_workers import die_last, die_once, numbered
from short_push import scenario_file

from omnimj.errors import InputError, SimulationError, UnknownNameError
from omnimj.studies.evaluation.cases import CasePopulation
from omnimj.studies.evaluation.study import EvaluationConfig, run_evaluation
from omnimj.studies.gap_benchmark.cases import draw_cases
from omnimj.studies.gap_benchmark.datasets import make_dataset
from omnimj.studies.gap_benchmark.trial import fit_truth, search_case
from omnimj.studies.runner import TrialFolder
from omnimj.studies.sensitivity.trial import TrialConfig, drive_with
from omnimj.studies.tuning.draws import draw_trial, read_tuned_scenarios
from omnimj.studies.tuning.trial import drive_trial
from omnimj.studies.workers import (
    WorkerLost,
    WorkerPool,
    job_options,
    open_executor,
    parse_scheduler,
    parse_slurm,
    run_in_workers,
)


@contextmanager
def cluster_of(workers: int, **more: Any) -> Iterator[Any]:
    """A cluster on this machine."""
    distributed = pytest.importorskip("distributed")
    with (
        warnings.catch_warnings(),
        distributed.LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            dashboard_address=":0",  # any free port
            host="127.0.0.1",
            silence_logs=50,
            **more,
        ) as found,
    ):
        warnings.simplefilter("ignore")  # of the library's own shutdown
        yield found


@pytest.fixture(scope="module")
def cluster():
    """Two worker processes."""
    with cluster_of(2, processes=True) as found:
        yield found


@pytest.fixture
def dask(cluster):
    """Of two worker processes."""
    with open_executor(f"dask:{cluster.scheduler_address}") as executor:
        yield executor


@pytest.fixture
def dask_here():
    """Of two workers in threads of this process, which are sent their work over a socket all the same."""
    with (
        cluster_of(2, processes=False, protocol="tcp://") as found,
        open_executor(f"dask:{found.scheduler_address}") as executor,
    ):
        yield executor


@pytest.fixture
def dask_of_one():
    """Of one worker process; when it dies, the cluster starts another."""
    with (
        cluster_of(1, processes=True) as found,
        open_executor(f"dask:{found.scheduler_address}") as executor,
    ):
        yield executor


def driven_by_all(function: Callable[..., Any], tasks: Mapping[str, tuple], dask: Executor) -> dict[str, Any]:
    """What comes of the tasks, by name; the same by threads, by processes and by a cluster."""

    def driven(executor: Executor | None) -> dict[str, Any]:
        found: dict[str, Any] = {}
        assert run_in_workers(
            lambda w: w.run_all(function, tasks, found.__setitem__, "driving", quiet), 1, executor
        )
        return found

    with ThreadPoolExecutor(2) as threads:
        here = driven(threads)
    assert driven(None) == here
    assert driven(dask) == here
    return here


@pytest.mark.slow
def test_an_evaluation_by_processes_by_a_thread_and_by_a_cluster_is_the_same(tmp_path, dask):
    def evaluated(name: str, executor: Executor | None) -> str:
        choice = CasePopulation("manoeuvres", 100, duration=2.5)
        order = EvaluationConfig(tmp_path / name, choice, "robust", trials=3, workers=1)
        outcome = run_evaluation(order, quiet, executor)
        assert not outcome.interrupted and not outcome.failed
        found = [dict(TrialFolder(order.out / "cases").read(f"case_{k:05d}") or {}) for k in range(3)]
        return str([{key: value for key, value in one.items() if key != "speed"} for one in found])

    with open_executor("threads", 2) as threads:
        here = evaluated("threads", threads)
    assert evaluated("processes", None) == here
    assert evaluated("dask", dask) == here
    assert "diagnoses" in here


@pytest.mark.slow
def test_trials_of_a_tuning_are_the_same_by_processes_by_a_thread_and_by_a_cluster(tmp_path, dask_here):
    file = scenario_file(tmp_path, faults="")
    (scenario,) = read_tuned_scenarios((file,), None).values()
    tasks = {
        f"{k}_{gain}": (
            draw_trial(file, scenario, 5, k, "planar"),
            {"control.speed_integral": gain},
            None,
        )
        for k in range(2)
        for gain in (1.0, 4.0)
    }

    here = driven_by_all(drive_trial, tasks, dask_here)
    assert here["0_1.0"] != here["0_4.0"] and "facts" in str(here["0_1.0"])


@pytest.mark.slow
def test_runs_of_a_sensitivity_study_are_the_same_by_processes_by_a_thread_and_by_a_cluster(tmp_path, dask):
    file = Path(scenario_file(tmp_path, faults=""))
    tasks = {str(mass): (TrialConfig(str(file)), {"body.mass": mass}, 3) for mass in (20.0, 30.0)}
    here = driven_by_all(drive_with, tasks, dask)
    assert here["20.0"]["results"] != here["30.0"]["results"]
    # a worker that lives on reads a file that has changed since
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace("speed = 0.4", "speed = 0.2"), encoding="utf-8")
    assert driven_by_all(drive_with, tasks, dask)["20.0"] != here["20.0"]


@pytest.mark.slow
def test_cases_of_the_gap_benchmark_are_the_same_by_processes_by_threads_and_by_a_cluster(tmp_path, dask):
    """Made, searched and fitted; the replays of a search run in threads of their own."""
    hidden = [case for case in draw_cases(3) if case.kind == "single"][:2]

    def benchmark(name: str, executor: Executor | None) -> list[Any]:
        folder, found = tmp_path / name, {}
        folder.mkdir()
        plans = {case.name: (case, folder / case.name, "twin", 0.6, 3) for case in hidden}
        searches = {case.name: (str(folder / case.name),) for case in hidden}
        fits = {case.name: (str(folder / case.name), case.to_dict()["hidden"]) for case in hidden}

        def work(pool: WorkerPool) -> None:
            for step, tasks in ((make_dataset, plans), (search_case, searches), (fit_truth, fits)):
                found[step.__name__] = {}
                pool.run_all(step, tasks, found[step.__name__].__setitem__, "working", quiet)

        assert run_in_workers(work, 2, executor)
        for result in found["search_case"].values():
            del result["seconds"], result["gap"]["seconds"], result["gap"]["dataset"]
        return [found["search_case"], found["fit_truth"]]

    with open_executor("threads", 2) as threads:
        here = benchmark("threads", threads)
    assert all("error" not in result for step in here for result in step.values())
    assert benchmark("processes", None) == here
    assert benchmark("dask", dask) == here


@pytest.mark.slow
def test_work_whose_worker_is_killed_is_done_by_another(tmp_path, dask_of_one):
    tasks = {f"task_{k}": (tmp_path / "mark", k) for k in range(8)}
    trials = TrialFolder(tmp_path)
    assert run_in_workers(
        lambda w: w.run_all(die_once, tasks, trials.write, "working", quiet), 1, dask_of_one
    )
    assert [trials.read(name) for name in tasks] == [{"number": k} for k in range(8)]


class Lossy(Executor):
    """Works at once, and loses the work of one name."""

    def __init__(self, lost: int):
        self._lost = lost

    def submit(self, fn, /, *args, **kwargs) -> Future:
        future: Future = Future()
        if args[-1] == self._lost:
            future.set_exception(WorkerLost("gone"))
        else:
            future.set_result(fn(*args, **kwargs))
        return future


def test_lost_work_is_reported_when_all_the_rest_is_kept_and_done_when_it_is_repeated(tmp_path):
    tasks, trials = {f"task_{k}": (k,) for k in range(5)}, TrialFolder(tmp_path)

    def work(workers):
        left = {name: given for name, given in tasks.items() if trials.read(name) is None}
        workers.run_all(numbered, left, trials.write, "working", quiet)

    with pytest.raises(SimulationError, match=r"a worker died; 1 of 5 are missing \(task_3\); .* continues"):
        run_in_workers(work, 1, Lossy(3))
    assert sum(trials.read(name) is not None for name in tasks) == 4
    assert run_in_workers(work, 1, Lossy(-1))
    assert trials.read("task_3") == {"number": 3}


def test_a_started_worker_process_that_dies_costs_what_was_under_way_and_nothing_else(tmp_path):
    """One after the other: what was finished before it died is kept, and the rest is done afterwards."""
    trials = TrialFolder(tmp_path)

    def work(workers):
        for k in range(3):
            workers.run_all(die_last, {f"task_{k}": (k,)}, trials.write, "working", quiet)

    with pytest.raises(SimulationError, match=r"a worker died; .* are missing"):
        run_in_workers(work, 1)
    assert [trials.read(f"task_{k}") for k in range(3)] == [{"number": 0}, {"number": 1}, None]
    run_in_workers(lambda w: w.run_all(numbered, {"task_2": (2,)}, trials.write, "working", quiet), 1)
    assert trials.read("task_2") == {"number": 2}


@pytest.mark.slow
def test_work_that_kills_every_worker_is_given_up_and_the_rest_is_done(tmp_path, dask, cluster):
    tasks, trials = {f"task_{k}": (k,) for k in range(3)}, TrialFolder(tmp_path)
    cluster.scheduler.allowed_failures = 1
    with pytest.raises(SimulationError, match=r"a worker died; 1 of 3 are missing \(task_2\)"):
        run_in_workers(lambda w: w.run_all(die_last, tasks, trials.write, "working", quiet), 1, dask)
    assert [trials.read(f"task_{k}") for k in (0, 1)] == [{"number": 0}, {"number": 1}]


@pytest.mark.parametrize(
    "address",
    [
        "tcp://127.0.0.1:8786",
        "dask:127.0.0.1:8786",
        "dask:tcp://127.0.0.1",
        "dask:tcp://a b:1",
        "dask:tcp://a:0",
        "dask:tcp://a:99999",
        "dask:tcp://a:1/x",
        "ray:tcp://a:1",
        "",
    ],
)
def test_an_address_of_another_shape_is_refused(address):
    with (
        pytest.raises(
            InputError, match=r"--executor: found .*; an executor is one of these; choices: dask:tcp"
        ),
        open_executor(address),
    ):
        raise AssertionError("opened")


def test_addresses_of_schedulers():
    assert parse_scheduler("dask:tcp://node-1.lab:8786") == "tcp://node-1.lab:8786"
    assert parse_scheduler("dask:tls://[::1]:8786") == "tls://[::1]:8786"
    with open_executor(None) as executor:
        assert executor is None


@pytest.mark.parametrize(
    "error", [InputError("here", "two", "one", ("a",)), UnknownNameError("a", "b", "c", "d")]
)
def test_an_error_of_a_worker_arrives_with_its_kind_and_its_words(error):
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is type(error) and str(again) == str(error)


@pytest.mark.parametrize("own", [True, False])
def test_a_full_disk_costs_no_finished_trial_and_the_rest_is_done_later(tmp_path, own):
    trials, room = TrialFolder(tmp_path / "trials"), [3]

    def store(name: str, result: Any) -> None:
        if room[0] == 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        room[0] -= 1
        trials.write(name, {"value": result})

    def drive_the_rest() -> bool:
        tasks = {str(k): (k, 2.0) for k in range(6) if trials.finished(str(k)) is None}
        with ThreadPoolExecutor(1) as threads:
            return run_in_workers(
                lambda pool: pool.run_all(pow, tasks, store, "raising", quiet), 1, None if own else threads
            )

    with pytest.raises(OSError, match="No space left"):
        drive_the_rest()
    kept = [k for k in range(6) if trials.finished(str(k)) is not None]
    assert len(kept) == 3
    room[0] = 6
    assert drive_the_rest()
    assert [trials.read(str(k)) for k in range(6)] == [{"value": k**2.0} for k in range(6)]
    assert room[0] == 3  # nothing that was finished is done again


FAKE_SBATCH = """#!/bin/sh
cp "$1" "{folder}/job.sh"
setsid bash "{folder}/job.sh" > "{folder}/job.log" 2>&1 &
echo $! > "{folder}/job.pid"
echo "Submitted batch job 7"
"""
FAKE_SCANCEL = """#!/bin/sh
kill -- -$(cat "{folder}/job.pid")
"""


@pytest.mark.slow
def test_jobs_of_a_slurm_cluster_do_the_same_work(tmp_path, monkeypatch):
    """The commands of SLURM are stand-ins that run a job's script on this machine."""
    pytest.importorskip("dask_jobqueue")
    for name, text in (("sbatch", FAKE_SBATCH), ("scancel", FAKE_SCANCEL)):
        (tmp_path / name).write_text(text.format(folder=tmp_path), encoding="utf-8")
        (tmp_path / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    monkeypatch.chdir(tmp_path)  # jobs leave their files where they are submitted
    tasks = {str(k): (k, 3.0) for k in range(4)}
    found: dict[str, Any] = {}
    with (
        warnings.catch_warnings(),
        open_executor("slurm:jobs=1,cores=1,memory=500MB,walltime=00:05:00") as executor,
    ):
        warnings.simplefilter("ignore")  # of the library's own shutdown
        work = functools.partial(WorkerPool.run_all, function=pow, tasks=tasks, store=found.__setitem__)
        assert run_in_workers(lambda pool: work(pool, phrase="raising", report=quiet), 1, executor)
    assert found == {str(k): k**3.0 for k in range(4)}


def test_the_script_of_a_job_asks_for_what_the_address_says():
    jobs = pytest.importorskip("dask_jobqueue.slurm")
    options = parse_slurm("slurm:jobs=3,cores=8,memory=16GB,walltime=02:30:00,queue=short,account=lab-1")
    script = jobs.SLURMJob("tcp://127.0.0.1:1", name="omnimj", **job_options(options)).job_script()
    for words in ("--cpus-per-task=8", "--mem=15G", "-t 02:30:00", "-p short", "-A lab-1", sys.executable):
        assert words in script
    assert "--nworkers 8" in script and "--nthreads 1" in script


@pytest.mark.parametrize(
    "options",
    ["jobs=0", "jobs=2,jobs=3", "cores", "memory=8", "walltime=5", "speed=1", "queue=a b", "jobs=1;x"],
)
def test_options_of_a_slurm_cluster_of_another_shape_are_refused(options):
    with pytest.raises(InputError, match="--executor slurm:"):
        parse_slurm(f"slurm:{options}")


def test_without_sbatch_the_error_says_where_to_go(monkeypatch):
    pytest.importorskip("dask_jobqueue")
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(InputError, match="no sbatch on this machine"), open_executor("slurm:jobs=2"):
        raise AssertionError("opened")


def test_an_address_without_a_scheduler_is_reported_soon():
    pytest.importorskip("distributed")
    with (
        pytest.raises(InputError, match=r"no scheduler answers .*; is a Dask scheduler running") as caught,
        open_executor("dask:tcp://127.0.0.1:9", timeout=0.5),
    ):
        raise AssertionError("opened")
    assert "\n" not in str(caught.value)


def test_a_library_that_is_not_installed_is_reported(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with (
        pytest.raises(InputError, match=r"distributed is not installed; pip install 'omnimj\[dask\]'"),
        open_executor("dask:tcp://127.0.0.1:9"),
    ):
        raise AssertionError("opened")
