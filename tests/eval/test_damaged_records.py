"""Records of an evaluation that somebody damaged are one clear error, not a traceback."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from swardmap.errors import InputError
from swardmap.eval.compare import compare_runs
from tests.fuzz.saved import evaluation

DAMAGE: dict[str, Callable[[dict[str, Any]], object]] = {
    "no name": lambda record: record.pop("name"),
    "no maps": lambda record: record.pop("maps"),
    "no mask": lambda record: record.pop("mask"),
    "no counts": lambda record: record["mask"].pop("counts"),
    "no safety": lambda record: record.pop("safety"),
    "another role": lambda record: record["mask"].update(roles=["what", "free"]),
}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    folder = tmp_path_factory.mktemp("evaluation")
    return folder, evaluation(folder)[1]


@pytest.mark.parametrize("damage", DAMAGE.values(), ids=list(DAMAGE))
def test_damaged_records_do_not_compare(
    whole: tuple[Path, str], tmp_path: Path, damage: Callable[[dict[str, Any]], object]
) -> None:
    folder, part = whole
    damaged = shutil.copytree(folder, tmp_path / "damaged")
    records = [json.loads(line) for line in (damaged / part).read_text().splitlines()]
    damage(records[0])
    (damaged / part).write_text("".join(json.dumps(record) + "\n" for record in records))
    for runs in ([folder, damaged], [damaged, folder]):
        with pytest.raises(InputError, match="damaged"):
            compare_runs(runs)
    assert compare_runs([folder, folder])[0].frames == 2
