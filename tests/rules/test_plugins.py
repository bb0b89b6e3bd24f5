"""Readers, laws and strategies of another installed package, which no import of emgface loads."""

import json
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from zipfile import ZipFile

import pytest
import xarray as xr
from hatchling.builders.wheel import WheelBuilder

from emgface.children import child_environment, python_command
from emgface.errors import ConfigurationError
from emgface.face.tissue import law_named
from emgface.plugins import plugins
from emgface.recordings.dataset import read_recording, readers
from emgface.signals.parameters import StrategyParameters
from emgface.signals.strategies import select_muscles

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "extend.md").read_text(encoding="utf-8")
METADATA = "Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n"
MADE = """
import json, sys
from pathlib import Path
import numpy as np
import xarray as xr
import emgface as ef
"""


def blocks() -> dict[str, str]:
    """Files of the example package of the page, by their names in the line above each."""
    pattern = r"`(lab_parts/\S+)`:\n\n```\w+\n(.*?)^```"
    return dict(re.findall(pattern, PAGE, re.M | re.S))


def install(folder: Path, name: str, points: str, files: dict[str, str]) -> None:
    """Files of a package and its metadata, as `pip install` writes them."""
    for path, text in files.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(text, encoding="utf-8")
    metadata = folder / f"{name}-1.0.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text(METADATA.format(name=name))
    (metadata / "entry_points.txt").write_text(points)


@pytest.fixture(scope="module")
def installed(tmp_path_factory) -> Path:
    """Folder in which the example package of the page is installed, from nothing but its files."""
    folder, source = tmp_path_factory.mktemp("site"), tmp_path_factory.mktemp("source")
    for path, text in blocks().items():
        (source / path).parent.mkdir(parents=True, exist_ok=True)
        (source / path).write_text(text, encoding="utf-8")
    builder = WheelBuilder(str(source / "lab_parts"))
    (wheel,) = builder.build(directory=str(source / "dist"), versions=["standard"])
    with ZipFile(wheel) as archive:
        archive.extractall(folder)
    return folder


def answer(text: str, *search: Path) -> dict:
    """What a process that finds the packages in some folders prints as JSON."""
    folders = [*map(str, search), str(ROOT)]
    done = subprocess.run(
        python_command("-c", MADE + text),
        capture_output=True,
        text=True,
        env=child_environment(folders) | {"PYTHONPATH": ":".join(folders)},
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout.splitlines()[-1])


def test_parts_of_the_page_are_used_and_imported_only_then(installed: Path, tmp_path: Path) -> None:
    (tmp_path / "A_1.volts").write_text("rate 1000\nZYG_L\n" + "0.001\n-0.001\n" * 500)
    reply = answer(
        f"""
from emgface.face.tissue import Tissue
from emgface.run.store import Store
from emgface.signals.parameters import SignalChain, StrategyParameters
from emgface.signals.strategies import select_muscles
from emgface.study.configuration import StudyConfiguration
from emgface.study.stage_code import ACTIVATION, MOTION

mine = lambda: sorted(name for name in sys.modules if name.startswith("lab_parts"))
study = StudyConfiguration(strategies=("act_all", "strongest"))
unused = mine()
soft = Tissue(law="soft_skin")
read = ef.read(Path({str(tmp_path)!r}) / "A_1.volts")
after_read = mine()
time = np.arange(50)
feature = xr.DataArray(
    [time, 3 * time, 2 * time, 2 * time], dims=("muscle", "time"),
    coords=dict(muscle=["DAO_L", "ZYG_L", "ZYG_R", "DAO_R"]),
)
store = Store(Path({str(tmp_path)!r}) / "store")
key = store.key(ACTIVATION, {{}}, dict(trial_strategy="strongest"))
plain = store.key(ACTIVATION, {{}}, dict(trial_strategy="act_all"))
print(json.dumps(dict(
    unused=unused, after_read=after_read, strategies=study.strategies,
    emg=read.emg.values[0, :2].tolist(), units=read.emg.attrs["units"],
    label=str(read.channel.values[0]), rate=1 / float(np.diff(read.time_emg.values[:2])[0]),
    selected=select_muscles(feature, "strongest", None, StrategyParameters()),
    C10=soft.passive_law().C10, stiffer=soft.stiffened(2.0).passive_law().C10,
    law=str(Tissue(law="soft_skin", coefficients=dict(C10=900.0)).passive_law()),
    plugins=list(key["code"].get("plugins", ())), plain="plugins" in plain["code"],
    of_law=list(store.key(MOTION, {{}}, soft.model_dump(mode="json"))["code"]["plugins"]),
)))
""",
        installed,
    )
    assert reply["unused"] == []
    assert "lab_parts.volts" in reply["after_read"]
    assert "lab_parts.strongest" not in reply["after_read"]
    assert reply["strategies"] == ["act_all", "strongest"]
    assert (reply["emg"], reply["units"], reply["label"]) == ([0.001, -0.001], "V", "ZYG_L")
    assert reply["rate"] == pytest.approx(1000.0)
    assert reply["selected"] == ["ZYG"]
    assert (reply["C10"], reply["stiffer"]) == (1000.0, 2000.0)
    assert "900" in reply["law"]
    assert reply["plugins"] == ["strategy strongest"] and not reply["plain"]
    assert reply["of_law"] == ["law soft_skin"]


def test_the_force_of_a_law_of_another_package_is_that_of_its_base(installed: Path) -> None:
    reply = answer(
        """
from emgface.face.tissue import Tissue
I1bar = np.linspace(3.0, 4.0, 5)
own = Tissue(law="soft_skin").passive_law().evaluate(I1bar)
base = Tissue(coefficients=dict(C10=1000.0, C20=0.0)).passive_law().evaluate(I1bar)
print(json.dumps(dict(same=[bool(np.array_equal(a, b)) for a, b in zip(own, base)])))
""",
        installed,
    )
    assert reply["same"] == [True, True, True]


BROKEN = {
    "conflict": ("[emgface.strategies]\nact_3 = odd:select\n", "name of one of emgface"),
    "meaning": ("[emgface.strategies]\ninverse = odd:select\n", "name of one of emgface"),
    "absent": ("[emgface.strategies]\nodd = odd:nothing\n", "cannot be imported (AttributeError"),
    "failing": ("[emgface.strategies]\nodd = odd:fail\n", "failed (ZeroDivisionError"),
    "none": ("[emgface.strategies]\nodd = odd:none\n", "selected nothing, expected some of ZYG"),
    "other": ("[emgface.strategies]\nodd = odd:other\n", "selected MEN, expected some of ZYG"),
    "name": ("[emgface.strategies]\nOdd-1 = odd:select\n", "expected a name of lower-case letters"),
    "law": ("[emgface.laws]\nodd = odd:select\n", "expected a dataclass with a law of sim"),
    "suffix": ("[emgface.readers]\ntrc = odd\n", "has the suffix of one of emgface"),
    "reader": ("[emgface.readers]\nodd = odd\n", "has no function read(path, units)"),
}  # fmt: skip
ODD = """
def select(feature, instruction, parameters):
    return ("ZYG",)
def fail(feature, instruction, parameters):
    return 1 / 0
def none(feature, instruction, parameters):
    return ()
def other(feature, instruction, parameters):
    return ("MEN",)
"""
FEATURE = xr.DataArray([[1.0, 2.0]], dims=("muscle", "time"), coords={"muscle": ["ZYG_L"]})


def strategy(name: str, folder: Path) -> object:
    return select_muscles(FEATURE, name, None, StrategyParameters())


def reader(name: str, folder: Path) -> object:
    path = folder / f"a.{name}"
    path.write_text("x")
    return read_recording(path)


USES = {"strategies": strategy, "laws": lambda name, _: law_named(name), "readers": reader}


@pytest.fixture
def add_package(monkeypatch, tmp_path: Path) -> Iterator[Callable[[str, str], None]]:
    """Function that installs a package with some entry points in this process."""

    def add(name: str, points: str) -> None:
        install(tmp_path / name, name, points, {f"{name}.py": ODD})
        monkeypatch.syspath_prepend(str(tmp_path / name))
        for each in (plugins, readers):
            each.cache_clear()

    yield add
    monkeypatch.undo()
    for name in ("odd", "even"):
        sys.modules.pop(name, None)
    for each in (plugins, readers):
        each.cache_clear()


@pytest.mark.parametrize("case", BROKEN)
def test_a_faulty_part_is_refused_where_it_is_used(case: str, add_package, tmp_path: Path) -> None:
    points, said = BROKEN[case]
    add_package("odd", points)
    kind, name = re.match(r"\[emgface\.(\w+)\]\n([\w-]+) =", points).groups()
    with pytest.raises(ConfigurationError, match="odd 1.0") as error:
        USES[kind](name, tmp_path)
    assert said in str(error.value)
    assert strategy("act_all", tmp_path) == ("ZYG",)  # what it does not concern is unaffected


def test_one_name_of_two_packages_is_refused(add_package, tmp_path: Path) -> None:
    for name in ("odd", "even"):
        add_package(name, f"[emgface.strategies]\nodd = {name}:select\n")
    with pytest.raises(ConfigurationError, match="even 1.0 and odd 1.0 exists more than once"):
        strategy("odd", tmp_path)
    with pytest.raises(ConfigurationError, match="did you mean 'odd'"):
        strategy("od", tmp_path)
