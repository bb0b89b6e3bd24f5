"""Execute notebooks and store their outputs, so that their pages in the documentation can be made.

``python notebooks/execute.py [NAME ...]``, after ``pip install '.[notebooks]'``. Interactive output is
stored as a still picture: a page with a moving face is larger than the notebook, and a slider is nothing
without a running kernel. Notebooks therefore run as if ipywidgets were not installed.
"""

import argparse
import re
import time
from base64 import b64decode, b64encode
from io import BytesIO
from pathlib import Path
from typing import Any

import nbformat
from nbclient import NotebookClient
from PIL import Image

FOLDER = Path(__file__).resolve().parent
WITHOUT_WIDGETS = "import sys; sys.modules['ipywidgets'] = None"
WIDGET = "application/vnd.jupyter.widget-view+json"


def execute(path: Path) -> float:
    """Execute one notebook, write it with its outputs, and return the seconds that it took."""
    notebook = nbformat.read(path, as_version=4)
    started = time.perf_counter()
    notebook.cells.insert(0, nbformat.v4.new_code_cell(WITHOUT_WIDGETS))
    NotebookClient(notebook, timeout=600, resources={"metadata": {"path": str(FOLDER)}}).execute()
    seconds = time.perf_counter() - started
    del notebook.cells[0]
    for cell in notebook.cells:
        if cell.cell_type == "code":
            cell.execution_count -= 1
            cell.outputs = [kept for output in cell.outputs if (kept := stored(output))]
            for output in cell.outputs:
                if output.output_type == "execute_result":
                    output.execution_count = cell.execution_count
            cell.metadata.pop("execution", None)
    notebook.metadata = {
        "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
        "language_info": {"name": "python"},
    }
    nbformat.write(notebook, path)
    return seconds


def stored(output: Any) -> Any | None:
    """Return an output as it is stored, None where nothing is."""
    if output.output_type == "stream":
        return output if output.name == "stdout" else None
    data = output.get("data", {})
    if WIDGET in data:
        return None
    if "image/png" in data:
        data.pop("text/html", None)
        data["image/png"] = small(data["image/png"])
    if "text/html" in data:  # pandas numbers its tables at random
        data["text/html"] = re.sub(r"T_[0-9a-f]{5}", "T", data["text/html"])
    return output


def small(picture: str) -> str:
    """Return a picture (PNG, base 64) with 256 colours, where that takes fewer bytes."""
    drawn = BytesIO()
    reduced = Image.open(BytesIO(b64decode(picture))).convert("RGB").quantize(256, kmeans=3)
    reduced.save(drawn, format="png", optimize=True)
    return min(picture, b64encode(drawn.getvalue()).decode("ascii"), key=len)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("names", nargs="*", help="notebooks without suffix; all when absent")
    for name in parser.parse_args().names or sorted(p.stem for p in FOLDER.glob("*.ipynb")):
        print(f"{name}: {execute(FOLDER / f'{name}.ipynb'):.0f} s", flush=True)
