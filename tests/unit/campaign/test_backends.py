"""Workers: threads, backends that are not there, a local Dask cluster."""

import builtins
import importlib.util
import os
from types import SimpleNamespace

import campaigns
import pytest
from joblib import Parallel, delayed
from told import refused

from dtbacklash.campaign.backends import THREADS, Launcher, Workers, check_backend, workers
from dtbacklash.errors import UserError
from dtbacklash.files import read_json


def threads():
    return {name: os.environ.get(name) for name in THREADS}


@pytest.fixture(autouse=True)
def environment(monkeypatch):
    for name in THREADS:
        monkeypatch.setenv(name, "7")


def alone(record):
    """Whether what a job spread stayed in its worker."""
    found = read_json(record)
    return set(found["inside"]) == {found["own"]} != {os.getpid()}


def test_a_worker_has_one_thread_and_spreads_nothing_further(tmp_path):
    with workers("loky", 2):
        assert Parallel()([delayed(threads)()]) == [dict.fromkeys(THREADS, "1")]
    Workers(jobs=2).do([campaigns.Nested(tmp_path / "job.json")])
    assert alone(tmp_path / "job.json")


@pytest.mark.parametrize(
    ("backend", "scheduler", "line"),
    [("slurm", None, "backend=slurm: choose one of loky, dask"),
     ("loky", "tcp://a:1", "scheduler=tcp://a:1: belongs to backend=dask")],
)  # fmt: skip
def test_a_wrong_backend_is_one_line(backend, scheduler, line):
    with refused(whole=line):
        check_backend(backend, scheduler)


def test_a_backend_that_is_not_installed_names_its_extra(monkeypatch):
    real = builtins.__import__

    def without(name, *words, **more):
        if name.startswith("distributed"):
            raise ImportError(name)
        return real(name, *words, **more)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(UserError, match=r"backend=dask: is not installed; pip install 'dtbacklash\[dask\]'"):
        check_backend("dask", None)


def test_a_launcher_gets_the_words_of_each_job_and_gives_back_what_a_worker_died_of(tmp_path):
    started = []

    def launch(words, initial_job_idx):
        started.extend(words)
        return [SimpleNamespace(_return_value=None), SimpleNamespace(_return_value=OSError(28, "full"))]

    jobs = [campaigns.Note(tmp_path / f"{j}.json") for j in range(2)]
    with pytest.raises(OSError, match="full"):
        Launcher(launch, lambda job: [f"seed={job.record.stem}"]).do(jobs)
    assert started == [["seed=0"], ["seed=1"]]


@pytest.mark.skipif(importlib.util.find_spec("distributed") is None, reason="the extra dask is not installed")
def test_a_local_dask_cluster_does_the_work(tmp_path):
    records = [tmp_path / f"{j}.json" for j in range(4)]
    Workers("dask", 2).do([campaigns.Nested(record) for record in records])
    assert all(map(alone, records))
    with workers("dask", 2):
        assert Parallel()([delayed(threads)()]) == [dict.fromkeys(THREADS, "1")]
