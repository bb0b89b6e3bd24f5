"""Documentation of own data: all keys are documented, and the commands run."""

import re
import shlex
import tomllib
from pathlib import Path
from typing import get_args

import pytest
import xarray as xr
from typer.testing import CliRunner

from emgface.choices import configure
from emgface.cli import app
from emgface.recordings.labels import LabelMap
from emgface.recordings.readers.csv_toml import Sidecar
from emgface.study.configuration import StudyConfiguration
from tests.study.recordings import recording_of

MODELS = {"sidecar": Sidecar, "mapping": LabelMap, "study": StudyConfiguration}


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", page.read_text(encoding="utf-8"), flags=re.S)


def keys(*models) -> set[str]:
    return {field.alias or name for model in models for name, field in model.model_fields.items()}


def test_the_page_of_sidecars_lists_every_key(root: Path) -> None:
    text = (root / "docs" / "sidecars.md").read_text(encoding="utf-8")
    tables = [
        set(re.findall(r"^\| `(\w+)` \|", part, flags=re.M))
        for part in re.split(r"\| key \|", text)[1:]
    ]
    signals = (Sidecar.model_fields[name].annotation for name in ("emg", "position"))
    inner = [next(iter(get_args(kind))) for kind in signals]  # of "table or None"
    assert tables == [keys(Sidecar), keys(*inner), keys(LabelMap)]


@pytest.mark.parametrize("page", ["sidecars.md", "worked_examples.md"])
def test_the_examples_of_toml_are_accepted(root: Path, page: str) -> None:
    examples = blocks(root / "docs" / page, "toml")
    assert len(examples) >= 2
    for text in examples:
        kind = re.match(r"# (\w+)\n", text)
        assert kind, text
        configure(MODELS[kind.group(1)], tomllib.loads(text))


@pytest.mark.filterwarnings("ignore::emgface.errors.FeatureWarning")
def test_the_worked_examples_run(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = root / "docs" / "worked_examples.md"
    monkeypatch.chdir(tmp_path)
    smile = recording_of(1)
    smile.to_netcdf("smile.nc")
    recording_of(2, gain=3.0).to_netcdf("mvc.nc")
    slow = smile.isel(time_emg=slice(None, None, 2))
    time = slow["time_emg"] * 1.024  # 1000 Hz
    slow.assign_coords(time_emg=("time_emg", time.values, {"units": "s"})).to_netcdf("slow.nc")
    one = smile.sel(channel=["ZYG_L", "MEN_L"]).assign_coords(channel=["zygomaticus", "mentalis"])
    one.to_netcdf("one_side.nc")
    (tmp_path / "study.toml").write_text(blocks(page, "toml")[1])
    commands = [line for block in blocks(page, "sh") for line in block.splitlines()]
    assert len(commands) == 12
    for line in commands:
        program, *arguments = shlex.split(line)
        result = CliRunner().invoke(app, arguments)
        assert program == "emgface" and result.exit_code == 0, f"{line}\n{result.output}"
    trial, mvc = (xr.open_dataset(f"{n}.nc")["activation"] for n in ("trial", "mvc_normalised"))
    assert float(trial.sel(muscle="ZYG_L").max()) > 0.95 > float(mvc.sel(muscle="ZYG_L").max())
    step = xr.open_dataset("every_20_ms.nc")["time"].diff("time")
    assert float(step.mean()) == pytest.approx(0.02, rel=1e-6)
    mirrored = xr.open_dataset("mirrored.nc")["activation"]
    assert float(abs(mirrored.sel(muscle="ZYG_L") - mirrored.sel(muscle="ZYG_R")).max()) == 0.0
    assert (tmp_path / "bids" / "sub-P01" / "emg" / "sub-P01_task-smile_run-01_emg.bdf").is_file()
