"""Notebooks run without changes, label simulated data, and contain no data of the machine.

Only their code cells are executed, in order and in one namespace, without Jupyter.
"""

import ast
import json
import re
import warnings
from pathlib import Path
from typing import Any

import matplotlib
import pytest

from sim.threads import set_thread_count, thread_count
from tests.conftest import ROOT

NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
LARGEST = 400_000
"""Bytes of a notebook with its pictures; a larger one burdens every checkout."""

OURS = r"(emgface|sim|analysis)(\.|$)"
CELLS = "emgface.notebook"
"""Name of the module the cells run as, so that `OURS` covers warnings attributed to them."""

DEPRECATIONS = (DeprecationWarning, PendingDeprecationWarning, FutureWarning)


def sources(path: Path, kind: str) -> list[str]:
    """Texts of all cells of a kind."""
    notebook = json.loads(path.read_text(encoding="utf-8"))
    return ["".join(c["source"]) for c in notebook["cells"] if c["cell_type"] == kind]


def execute(path: Path) -> dict[str, Any]:
    """Run the code cells of a notebook; an error is noted with the number of its cell."""
    namespace: dict[str, Any] = {"__name__": CELLS}
    with warnings.catch_warnings():
        for category in DEPRECATIONS:
            warnings.filterwarnings("error", category=category, module=OURS)
        for number, source in enumerate(sources(path, "code"), start=1):
            try:
                exec(compile(source, f"{path.name}, code cell {number}", "exec"), namespace)
            except Exception as error:
                error.add_note(f"in code cell {number} of {path.name}")
                raise
    return namespace


def simulates(path: Path) -> bool:
    """Test if a code cell imports simulated volunteers."""
    for source in sources(path, "code"):
        for node in ast.walk(ast.parse(source)):
            named = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            if named:
                named += [f"{named[0]}.{alias.name}" for alias in node.names]
            elif isinstance(node, ast.Import):
                named = [alias.name for alias in node.names]
            if any(f"{name}.".startswith("emgface.volunteers.") for name in named):
                return True
    return False


def says_simulated(path: Path) -> bool:
    return "simulated" in " ".join(sources(path, "markdown")).lower()


@pytest.fixture
def headless(tmp_path, monkeypatch):
    """Draw without a screen, in a separate folder, on one thread; close all figures."""
    import matplotlib.pyplot as plt

    monkeypatch.chdir(tmp_path)
    backend, threads = matplotlib.get_backend(), thread_count()
    matplotlib.use("Agg")
    set_thread_count(1)  # small meshes: more of them only wait for each other
    yield tmp_path
    plt.close("all")
    set_thread_count(threads)
    matplotlib.use(backend)


def written(folder: Path, *codes: str, markdown: str = "") -> Path:
    """Write a notebook of these cells."""
    cells = [{"cell_type": "markdown", "source": markdown}]
    cells += [{"cell_type": "code", "source": code} for code in codes]
    path = folder / "small.ipynb"
    path.write_text(json.dumps({"cells": cells}), encoding="utf-8")
    return path


def test_there_are_notebooks():
    assert NOTEBOOKS


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_runs(path, headless):
    # show() warns on Agg, which has no window.
    warnings.filterwarnings("ignore", message=".*non-interactive", category=UserWarning)
    execute(path)
    assert not list(headless.iterdir()), "a notebook leaves files in the reader's folder"


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_says_what_is_simulated(path):
    assert says_simulated(path) or not simulates(path)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_is_well_formed(path):
    notebook = json.loads(path.read_text(encoding="utf-8"))
    assert (notebook["nbformat"], notebook["nbformat_minor"]) == (4, 5)
    names = [cell["id"] for cell in notebook["cells"]]
    assert len(set(names)) == len(names)
    for cell in notebook["cells"]:
        needed = {"cell_type", "id", "metadata", "source"}
        needed |= {"outputs", "execution_count"} if cell["cell_type"] == "code" else set()
        assert set(cell) == needed
        kinds = {output["output_type"] for output in cell.get("outputs", [])}
        assert kinds <= {"stream", "display_data", "execute_result"}
        streams = {output.get("name", "stdout") for output in cell.get("outputs", [])}
        assert streams <= {"stdout"}


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_is_small_and_names_no_machine(path):
    assert path.stat().st_size < LARGEST
    text = re.sub(r'"image/png": ".*?"', "", path.read_text(encoding="utf-8"))
    assert not re.search(r"/(home|root|tmp|Users|work)/|[A-Z]:\\\\", text)


def test_outputs_are_all_there_or_none():
    for path in NOTEBOOKS:
        cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
        counts = [cell["execution_count"] for cell in cells if cell["cell_type"] == "code"]
        assert counts in ([None] * len(counts), list(range(1, len(counts) + 1)))


def test_cells_share_one_namespace(tmp_path):
    assert execute(written(tmp_path, "a = 2", "b = a + 1"))["b"] == 3


def test_an_error_names_its_cell(tmp_path):
    with pytest.raises(ZeroDivisionError) as caught:
        execute(written(tmp_path, "a = 1", "a / 0"))
    assert caught.value.__notes__ == ["in code cell 2 of small.ipynb"]


@pytest.mark.parametrize("category", DEPRECATIONS)
def test_a_deprecation_in_a_cell_is_an_error(tmp_path, category):
    code = f"import warnings\nwarnings.warn('old', {category.__name__})"
    with pytest.raises(category):
        execute(written(tmp_path, code))


def test_a_deprecation_in_our_packages_is_an_error(tmp_path):
    code = (
        "import warnings\nwarnings.warn_explicit('old', DeprecationWarning, 'x.py', 1, module='{}')"
    )
    with pytest.raises(DeprecationWarning):
        execute(written(tmp_path, code.format("analysis.align")))
    with pytest.warns(DeprecationWarning):
        execute(written(tmp_path, code.format("another.package")))


@pytest.mark.parametrize(
    "code",
    [
        "import emgface.volunteers",
        "from emgface import volunteers",
        "from emgface.volunteers.person import draw_volunteer",
    ],
)
def test_simulated_volunteers_must_be_called_so(tmp_path, code):
    silent = written(tmp_path, code, markdown="A person smiles.")
    assert simulates(silent) and not says_simulated(silent)
    assert says_simulated(written(tmp_path, code, markdown="A Simulated person smiles."))
    assert not simulates(written(tmp_path, "import emgface.schema.validation"))
