"""Notebooks run without changes, give their stored outputs, label simulated data, and name no machine.

Only their code cells are executed, in order and in one namespace, without Jupyter. What they print and
the text of their last expression are compared with what is stored; figures are not.
"""

import ast
import io
import json
import math
import re
import sys
import warnings
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import matplotlib
import pandas as pd
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


def execute(path: Path) -> tuple[dict[str, Any], list[str]]:
    """Run the code cells of a notebook; return their names and the text of each cell.

    An error is noted with the number of its cell.
    """
    namespace: dict[str, Any] = {"__name__": CELLS}
    texts = list[str]()
    with warnings.catch_warnings(), pd.option_context("display.max_columns", 20):  # as in Jupyter
        for category in DEPRECATIONS:
            warnings.filterwarnings("error", category=category, module=OURS)
        for number, source in enumerate(sources(path, "code"), start=1):
            try:
                with redirect_stdout(io.StringIO()) as printed:
                    value = run_cell(source, f"{path.name}, code cell {number}", namespace)
                    shown = "" if value is None else repr(value)
            except Exception as error:
                error.add_note(f"in code cell {number} of {path.name}")
                raise
            texts.append(f"{printed.getvalue()}\n{shown}")
    return namespace, texts


def run_cell(source: str, name: str, namespace: dict[str, Any]) -> Any:
    """Run a cell and return the value of its last line, as Jupyter shows it."""
    lines = ast.parse(source, name)
    last = lines.body.pop() if lines.body and isinstance(lines.body[-1], ast.Expr) else None
    exec(compile(lines, name, "exec"), namespace)
    if last is None:
        return None
    value = eval(compile(ast.Expression(last.value), name, "eval"), namespace)
    return None if source.rstrip().endswith(";") else value


def stored_texts(path: Path) -> list[str] | None:
    """Printed text and text of the last expression of each code cell, None if none was executed."""
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    cells = [cell for cell in cells if cell["cell_type"] == "code"]
    if all(cell["execution_count"] is None for cell in cells):
        return None
    texts = list[str]()
    for cell in cells:
        printed = ["".join(o["text"]) for o in cell["outputs"] if o["output_type"] == "stream"]
        shown = [
            "".join(o["data"]["text/plain"])
            for o in cell["outputs"]
            if o["output_type"] == "execute_result"
        ]
        texts.append("\n".join(["".join(printed), *shown]))
    return texts


MEASURED = r"[\d.]+ s\b|\b\d+ steps\b|(?m:^.*\[s\].*$)|0x[0-9a-f]+"
"""Run times, rows of a table in seconds, and addresses of objects, which differ in every run, and
numbers of steps, which a step control decides and another processor may change."""
NUMBER = r"(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?(?![\w.]*\w)"


def stale(stored: str, executed: str) -> str | None:
    """First difference of a stored text from the executed one, None if they are the same.

    Numbers are the same if they differ by no more than 1e-6 of their size or 1e-12, or, with decimals,
    by one unit of the last one printed: other processors and libraries give other last digits, which
    change the rounding of a printed one where it lies between two.
    """
    before, now = (re.split(f"({NUMBER})", re.sub(MEASURED, "*", t)) for t in (stored, executed))
    for a, b in zip(before, now, strict=False):
        if " ".join(a.split()) == " ".join(b.split()):
            continue
        if not (re.fullmatch(NUMBER, a) and re.fullmatch(NUMBER, b)):
            return f"{a!r} is stored, {b!r} executed"
        digits = len(a.partition(".")[2]) if "e" not in a else 0
        unit = 1.01 * 10.0**-digits if digits else 1e-12
        if not math.isclose(float(a), float(b), rel_tol=1e-6, abs_tol=unit):
            return f"{a} is stored, {b} executed"
    return None if len(before) == len(now) else f"{stored!r} is stored, {executed!r} executed"


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
    monkeypatch.setitem(sys.modules, "ipywidgets", None)  # as notebooks/execute.py stores them
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
    _, executed = execute(path)
    assert not list(headless.iterdir()), "a notebook leaves files in the reader's folder"
    stored = stored_texts(path) or executed
    differences = {
        n: stale(*texts) for n, texts in enumerate(zip(stored, executed, strict=True), 1)
    }
    differences = {n: text for n, text in differences.items() if text is not None}
    assert not differences, (
        "run python notebooks/execute.py, and read the prose that cites these numbers"
    )


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


@pytest.mark.parametrize(
    ("stored", "executed", "said"),
    [
        ("rho 0.68, 12 trials", "rho 0.68, 12 trials", None),
        ("rho 0.68, 12 trials", "rho 0.31, 12 trials", "0.68 is stored, 0.31 executed"),
        ("rho 0.68, 12 trials", "rho 0.68, 13 trials", "12 is stored, 13 executed"),
        ("a   1.0\nb  -2.5", "a   1.0\nb   2.5", "-2.5 is stored, 2.5 executed"),
        ("0.1234567890123", "0.1234567890124", None),
        (
            "0.1234567890123",
            "0.1234667890123",
            "0.1234567890123 is stored, 0.1234667890123 executed",
        ),
        ("2.2e-16", "3.1e-15", None),
        ("-0.0", "0.0", None),
        ("mean nan", "mean 0.1", "'mean nan' is stored, 'mean ' executed"),
        ("all 12", "all 12\n13", "'all 12' is stored, 'all 12\\n13' executed"),
        ("{'reduced': '0.09 s'}", "{'reduced': '1.29 s'}", None),
        ("per step [s]  5.0  0.05", "per step [s]  5.0  0.06", None),
        ("<View at 0x7f00>", "<View at 0x7e1a>", None),
        ("mean 0.759", "mean 0.760", None),
        ("mean 0.759", "mean 0.761", "0.759 is stored, 0.761 executed"),
        ("81 steps", "82 steps", None),
        ("3 of 4", "2 of 4", "3 is stored, 2 executed"),
        (
            "A: purse lips 2",
            "B: purse lips 2",
            "'A: purse lips ' is stored, 'B: purse lips ' executed",
        ),
    ],
)
def test_a_stale_text_is_reported(stored, executed, said):
    assert stale(stored, executed) == said


def test_a_stale_number_in_a_notebook_is_reported(tmp_path):
    path = written(tmp_path, "a = 0.5\nprint('rho', a)", "2 * a")
    notebook = json.loads(path.read_text(encoding="utf-8"))
    shown = {"output_type": "execute_result", "data": {"text/plain": ["1.3"]}}
    for cell, output in zip(
        notebook["cells"][1:],
        ({"output_type": "stream", "text": ["rho 0.5\n"]}, shown),
        strict=True,
    ):
        cell |= {"outputs": [output], "execution_count": 1}
    path.write_text(json.dumps(notebook), encoding="utf-8")
    stored, (_, executed) = stored_texts(path), execute(path)
    assert stored is not None
    messages = [stale(*texts) for texts in zip(stored, executed, strict=True)]
    assert messages == [None, "1.3 is stored, 1.0 executed"]


def test_cells_share_one_namespace(tmp_path):
    assert execute(written(tmp_path, "a = 2", "b = a + 1"))[0]["b"] == 3


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
