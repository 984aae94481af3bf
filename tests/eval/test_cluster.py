"""The same numbers on a Ray cluster of two nodes on this machine, also when one of them dies."""

import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from swardmap.config import config_from_dict
from swardmap.errors import InputError, MissingExtraError
from swardmap.eval.dataset import DatasetSpec
from swardmap.eval.frame import Plan
from swardmap.eval.run import evaluate, make_plan

pytestmark = [
    pytest.mark.slow,
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
    pytest.mark.filterwarnings("ignore::FutureWarning"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]


def plan_of(frames: int) -> Plan:
    config = config_from_dict({"segmenter": {"name": "colour"}})
    dataset = DatasetSpec(f"analytic:scenes=2,frames={frames},width=128")
    return make_plan(dataset, config, resolutions_m=(0.1,), protocols=("dense",))


@pytest.fixture
def cluster(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    pytest.importorskip("ray", reason="ray is not installed")
    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    monkeypatch.setenv("RAY_DISABLE_IMPORT_WARNING", "1")
    import ray
    from ray.cluster_utils import Cluster

    node = {"num_cpus": 1, "object_store_memory": 100_000_000, "include_dashboard": False}
    running = Cluster(initialize_head=True, head_node_args=node)
    yield running
    ray.shutdown()
    running.shutdown()


def test_two_nodes_give_the_numbers_of_one_process(cluster: Any, tmp_path: Path) -> None:
    cluster.add_node(num_cpus=1, object_store_memory=100_000_000)
    plan = plan_of(16)
    expected = evaluate(plan, tmp_path / "here", workers=1)
    assert evaluate(plan, tmp_path / "there", ray_address=cluster.address) == expected


def test_a_node_that_dies_loses_nothing(cluster: Any, tmp_path: Path) -> None:
    second = cluster.add_node(num_cpus=1, object_store_memory=100_000_000)
    plan = plan_of(40)
    expected = evaluate(plan, tmp_path / "here", workers=1)
    killer = threading.Thread(target=cluster.remove_node, args=(second,), kwargs={"allow_graceful": False})
    killed: list[int] = []

    def on_done(done: int, _: int) -> None:
        if done >= 16 and not killed:
            killed.append(done)
            killer.start()

    assert evaluate(plan, tmp_path / "there", ray_address=cluster.address, on_done=on_done) == expected
    killer.join()
    assert killed
    assert killed[0] < 80


def test_an_address_nobody_answers_is_one_clear_error(tmp_path: Path) -> None:
    try:
        with pytest.raises(InputError, match="no Ray cluster at"):
            evaluate(plan_of(1), tmp_path, ray_address="127.0.0.1:1")
    except MissingExtraError:
        pytest.skip("ray is not installed")
