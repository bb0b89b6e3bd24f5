"""A text export of AcqKnowledge, a real facial EMG, from the file to a moving face as the page states.

The commands are those of the section of docs/real_recording.md about this file. Skipped without the
shared folder, which contains the recording (countenance project, MIT licence).
"""

import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

import emgface as ef
from emgface.cli import app
from emgface.recordings.dataset import read_recording
from emgface.schema.netcdf import read_netcdf

ROOT = Path(__file__).parents[2]
FILE = "femg.txt"


def section() -> str:
    """Part of the page about the recording."""
    page = (ROOT / "docs" / "real_recording.md").read_text(encoding="utf-8")
    return page[page.index("A text export of AcqKnowledge") :]


def commands() -> list[list[str]]:
    """Arguments of its commands in their order."""
    blocks = re.findall(r"```sh\n(.*?)```", section(), re.S)
    return [shlex.split(line)[1:] for block in blocks for line in block.splitlines()]


def run(arguments: list[str], expected: int = 0) -> str:
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == expected, f"{arguments}: {result.output}"
    return " ".join(result.output.split())


@pytest.fixture(scope="module")
def folder(shared: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    source = shared / "reported" / "25-biopac-text" / FILE
    if not source.is_file():
        pytest.skip(f"the real recording {FILE} is not there")
    folder = tmp_path_factory.mktemp("chain")
    shutil.copy(source, folder / FILE)
    return folder


@pytest.fixture(scope="module")
def activation(folder: Path) -> xr.Dataset:
    """Activation by the commands of the page, with its threshold and without the levator."""
    described, mapped, cut, first, second = commands()[:5]
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        run(described)
        run(mapped)
        run(cut)
        output = run(first)
        assert "3.5" in output and "counts 0 to 28 of 199" in output, output
        mapping = Path("mapping.toml")
        lines = mapping.read_text(encoding="utf-8").splitlines()
        edited = [f"# {line}" if line.startswith('"Lev Raw"') else line for line in lines]
        assert edited != lines
        mapping.write_text("\n".join(edited) + "\n", encoding="utf-8")
        study = re.findall(r"```toml\n(.*?)```", section(), re.S)[0]
        Path("study.toml").write_text(study, encoding="utf-8")
        Path("smile.nc").unlink()
        run([*cut, "--force"])
        run(second)
        return read_netcdf(folder / "smile.nc", "activation")


def test_the_activation_is_that_of_the_burst(folder: Path, activation: xr.Dataset) -> None:
    """The zygomaticus alone is active, both sides alike, while its raw EMG is large."""
    active = activation["activation"].max("time")
    assert set(active["muscle"].values[active.values > 0.0]) <= {
        "ZYG_L", "ZYG_R", "BUC_L", "BUC_R",
    }  # fmt: skip
    zyg = activation["activation"].sel(muscle="ZYG_L")
    assert np.allclose(zyg, activation["activation"].sel(muscle="ZYG_R"))
    trial = read_recording(folder / "trials" / "femg_1.nc")
    emg = trial["emg"].sel(channel="ZYG_L")
    envelope = np.abs(emg - emg.mean()).rolling(time_emg=200, center=True).mean().dropna("time_emg")
    level = envelope.interp(time_emg=zyg["time"].values).values
    seen = np.isfinite(level)
    # rho of 0.9 is far from what activation of another time has: about 0 for a shift of half the trial
    assert np.corrcoef(level[seen], zyg.values[seen])[0, 1] > 0.9


def test_the_face_smiles_with_the_recorded_muscle(activation: xr.Dataset) -> None:
    """Corners move up and outward while the muscle is active, and hardly without the recording."""
    face = ef.face(resolution="coarse")
    free = {"accuracy": "draft", "contact": {"method": "none"}, "step": 0.02, "output": 0.02}
    motion = ef.simulate(activation, face, progress=False, **free)
    moved = 1e3 * (motion["position"] - motion["position"].isel(time=0))
    way = np.sqrt((moved**2).sum("axis"))
    zyg = activation["activation"].sel(muscle="ZYG_L")
    time = motion["time"] + float(zyg["time"][0]) - float(motion["time"][0])
    level = zyg.interp(time=time.values).values
    left, right = (way.sel(marker=f"corner_{side}").values for side in ("left", "right"))
    at = int(left.argmax())
    assert left[at] > 3.0 and level[at] > 0.5
    assert np.allclose(left, right, atol=0.05 * left.max())
    still = ef.simulate(
        activation.assign(activation=0.0 * activation["activation"]), face, progress=False, **free
    )
    idle = still["position"].sel(marker="corner_left")
    assert 1e3 * float(np.abs(idle - idle.isel(time=0)).max()) < 0.1 * left.max()
    one = moved.sel(marker="corner_left").transpose("time", "axis").values[at]
    other = moved.sel(marker="corner_right").transpose("time", "axis").values[at]
    assert one[2] > 0.0 and other[2] > 0.0  # up
    middle = motion["position"].isel(time=0).sel(axis="x")
    outward = np.sign(float(middle.sel(marker="corner_left") - middle.sel(marker="corner_right")))
    assert outward * one[0] > 0.0 and outward * other[0] < 0.0
    assert "simulated" in str(motion.attrs).lower()


@pytest.mark.slow
def test_the_page_states_the_displacement_that_its_command_gives(
    folder: Path, activation: xr.Dataset
) -> None:
    """With contact and the defaults, as in the last command; the page rounds to 0.1 mm."""
    stated = re.search(r"displaced by ([0-9.]+) mm", section())
    assert stated is not None and activation.sizes["time"] > 0
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        run(["build", "face", "--out", "face.nc", "--resolution", "coarse"])
        run(commands()[5])
    motion = read_netcdf(folder / "motion.nc", "trajectory")
    moved = motion["position"] - motion["position"].isel(time=0)
    farthest = 1e3 * float(np.sqrt((moved**2).sum("axis")).max())
    assert farthest == pytest.approx(float(stated.group(1)), abs=0.15)
