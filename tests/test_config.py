"""Settings: strict, ordered by precedence, and printable so that they read back."""

import os
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from swardmap.config import Config, GridConfig, config_from_dict, config_to_dict, config_to_yaml, load_config
from swardmap.errors import ConfigError


def test_printed_settings_read_back() -> None:
    for config in (
        Config(),
        Config(grid=GridConfig(origin_m=(1.5, -2.0), size_m=(10.0, 5.0)), backend="plain"),
    ):
        assert config_from_dict(yaml.safe_load(config_to_yaml(config))) == config
        assert config_from_dict(yaml.safe_load(config_to_yaml(config, comments=False))) == config
        assert config_from_dict(config_to_dict(config)) == config


def test_every_setting_says_what_it_is_for() -> None:
    for line in config_to_yaml(Config()).splitlines():
        if line.strip() and not line.startswith("#") and not line.endswith(":"):
            assert "# " in line


def test_precedence(tmp_path: Path) -> None:
    file = tmp_path / "mower.yaml"
    file.write_text("grid: {resolution_m: 0.2, min_points: 5}\ncloud: {max_range_m: 6}\n")
    environment = {
        "SWARDMAP_GRID__MIN_POINTS": "7",
        "SWARDMAP_DATA": "/x",
        "SWARDMAP_GARDEN_ASSETS": "/y",
        "SWARDMAP_BARS": "of a program beside us",
        "HOME": "/",
    }
    config = load_config(file, environment, ["cloud.max_range_m=5"])
    assert (config.grid.resolution_m, config.grid.min_points, config.cloud.max_range_m) == (0.2, 7, 5.0)
    assert config.cloud.min_range_m == Config().cloud.min_range_m


@pytest.mark.parametrize(
    ("override", "match"),
    [("grid.resolutoin_m=1", "did you mean 'resolution_m'"), ("gird.min_points=1", "did you mean 'grid'"),
     ("grid.resolution_m=-1", "at least 0.001"), ("grid.resolution_m=fine", "expected float"),
     ("grid.min_points=1.5", "expected int"), ("grid.min_points=true", "expected int"),
     ("grid.resolution_m=.nan", "expected float"), ("backend=motorway", "one of compiled, plain"),
     ("grid=3", "expected keys"), ("grid.origin_m=[1]", "list of 2"), ("grid.origin_m=[1, 2]", "together"),
     ("grid={origin_m: [0, 0], size_m: [-4, -4]}", "got -4 x -4 m in cells of 0.05 m"),
     ("grid={origin_m: [0, 0], size_m: [1e6, 1e6]}", "size_m and resolution_m of 1 to 64000000 cells"),
     ("cloud.min_range_m=9", "min_range_m below max_range_m"), ("nonsense", "section.key=value"),
     ("source.level=1", "expected bool")],
)  # fmt: skip
def test_mistakes_are_named(override: str, match: str) -> None:
    with pytest.raises(ConfigError, match=match):
        load_config(overrides=[override])


def test_exponents_and_whole_numbers_are_numbers() -> None:
    assert load_config(overrides=["grid.resolution_m=1e-1"]).grid.resolution_m == 0.1
    assert load_config(overrides=["cloud.max_range_m=5"]).cloud.max_range_m == 5.0


def test_unreadable_files_are_one_error(tmp_path: Path) -> None:
    for name, content in (("bad.yaml", b"a: [1"), ("bytes.yaml", b"\xff\xfe\x00"), ("list.yaml", b"- 1")):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(ConfigError):
            load_config(tmp_path / name)
    with pytest.raises(ConfigError, match="cannot read"):
        load_config(tmp_path / "missing.yaml")
    (tmp_path / "empty.yaml").write_text("")
    assert load_config(tmp_path / "empty.yaml") == Config()


@given(st.text(max_size=40))
def test_no_text_breaks_the_loader(text: str) -> None:
    try:
        load_config(overrides=[text])
    except ConfigError:
        return
    assert "=" in text


def test_settings_of_earlier_versions_have_the_names_of_today() -> None:
    old = config_from_dict({"road": "staged", "grid": {"mode": "evidence"}})
    assert (old.backend, old.grid.mode) == ("plain", "log_odds")
    assert config_from_dict({"grid": {"mode": "paper"}}) == Config()
    assert load_config(overrides=["road=fused"]).backend == "compiled"
    assert load_config(environment={"SWARDMAP_ROAD": "staged"}).backend == "plain"


@pytest.mark.parametrize(
    ("name", "match"),
    [("SWARDMAP_GIRD__MIN_POINTS", "SWARDMAP_GIRD__MIN_POINTS.*did you mean SWARDMAP_GRID"),
     ("SWARDMAP_BARS__COUNT", "SWARDMAP_BARS__COUNT: expected SWARDMAP_SECTION__KEY"),
     ("SWARDMAP_GRIDS", "did you mean SWARDMAP_GRID"),
     ("SWARDMAP_GRID__MIN_POINT", "did you mean 'min_points'.*environment: SWARDMAP_GRID__MIN_POINT"),
     ("SWARDMAP_GRID__MODE", "expected str.*environment: SWARDMAP_GRID__MODE")],
)  # fmt: skip
def test_a_mistake_in_the_environment_names_the_variable(name: str, match: str) -> None:
    with pytest.raises(ConfigError, match=match):
        load_config(environment={name: "7"})


def bomb(levels: int = 12) -> str:
    """Each list holds the one before nine times: a kilobyte that unfolds to 9^12 words."""
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, levels)]
    return "\n".join(lines)


@pytest.mark.timeout(20)
@pytest.mark.parametrize(
    "text",
    [bomb(), "a: &a [*a]", "a: " + "[" * 3000, "grid: !!bool x", 'grid: !!int ""', "grid: !!timestamp x",
     "grid: !!python/object/apply:os.getcwd []", "grid: 2020-13-45",
     "cloud: {max_range_m: " + "9" * 400 + "}",
     "grid: " + "1" * 5000, "\x00", "x: " + "y" * (1 << 20)],
)  # fmt: skip
def test_no_file_of_settings_is_a_bomb(tmp_path: Path, text: str) -> None:
    (tmp_path / "c.yaml").write_text(text)
    with pytest.raises(ConfigError) as refused:
        load_config(tmp_path / "c.yaml")
    assert len(str(refused.value)) < 500
    assert "\n" not in str(refused.value)
    if text.startswith("grid: !"):
        with pytest.raises(ConfigError):
            load_config(overrides=[text.replace(": ", "=", 1)])


def test_settings_are_read_from_regular_files_only(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.yaml")
    for path in (tmp_path / "pipe.yaml", Path("/dev/zero"), tmp_path):
        with pytest.raises(ConfigError, match="no regular file"):
            load_config(path)
