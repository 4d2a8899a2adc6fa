"""Workers: threads, backends that are not there, a local Dask cluster."""

import builtins
import importlib.util
import os

import pytest
from joblib import Parallel, delayed

from dtbacklash.errors import UserError
from dtbacklash.prove.backend import THREADS, check_backend, workers
from dtbacklash.prove.work import _alone


def threads():
    return {name: os.environ.get(name) for name in THREADS}


def nested():
    with _alone():
        return Parallel()(delayed(os.getpid)() for _ in range(3)), os.getpid()


@pytest.fixture(autouse=True)
def environment(monkeypatch):
    for name in THREADS:
        monkeypatch.setenv(name, "7")


def test_a_worker_has_one_thread_and_spreads_nothing_further():
    with workers("loky", 2):
        assert Parallel()([delayed(threads)()]) == [dict.fromkeys(THREADS, "1")]
        ((inside, own),) = Parallel()([delayed(nested)()])
    assert set(inside) == {own} != {os.getpid()}


@pytest.mark.parametrize(
    ("backend", "scheduler", "line"),
    [("slurm", None, "backend=slurm: choose one of loky, dask, ray"),
     ("loky", "tcp://a:1", "scheduler=tcp://a:1: belongs to backend=dask or backend=ray")],
)  # fmt: skip
def test_a_wrong_backend_is_one_line(backend, scheduler, line):
    with pytest.raises(UserError) as caught:
        check_backend(backend, scheduler)
    assert str(caught.value) == line


@pytest.mark.parametrize("backend", ["dask", "ray"])
def test_a_backend_that_is_not_installed_names_its_extra(backend, monkeypatch):
    real = builtins.__import__

    def without(name, *words, **more):
        if name.startswith(("distributed", "ray")):
            raise ImportError(name)
        return real(name, *words, **more)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(UserError, match=rf"backend={backend}: is not installed; pip install 'dtbacklash\[{backend}\]'"):
        check_backend(backend, None)


@pytest.mark.skipif(importlib.util.find_spec("distributed") is None, reason="the extra dask is not installed")
def test_a_local_dask_cluster_does_the_work():
    with workers("dask", 2):
        found = list(Parallel(return_as="generator_unordered", batch_size=1)(delayed(nested)() for _ in range(4)))
        assert Parallel()([delayed(threads)()]) == [dict.fromkeys(THREADS, "1")]
    assert all(set(inside) == {own} != {os.getpid()} for inside, own in found)


@pytest.mark.skipif(importlib.util.find_spec("ray") is None, reason="the extra ray is not installed")
def test_a_local_ray_cluster_does_the_work():
    with workers("ray", 2):
        assert os.getpid() not in Parallel()(delayed(os.getpid)() for _ in range(4))
