"""Pages of the notebooks, made from their stored outputs when the documentation is built.

`docs/conf.py` calls `make`. Nothing is executed: each notebook becomes a Markdown page with its text,
code, printed results, tables and pictures, and `gallery.md` shows one picture of each.
"""

import base64
import json
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
ORDER = (
    "one_face_one_smile",
    "signal_to_motion",
    "c3d_to_activation",
    "whole_study",
    "what_rho_means",
    "jaw_from_emg",
    "one_head",
    "face_of_a_person",
    "voice_of_a_face",
    "reduced_face",
    "published_tables",
    "laws",
)


def make(notebooks: Path = HERE.parents[1] / "notebooks", out: Path = HERE / "generated") -> None:
    """Write the pages of all notebooks and their pictures; unchanged files are not written."""
    names = sorted((path.stem for path in notebooks.glob("*.ipynb")), key=_place)
    cards = []
    for name in names:
        cells = json.loads((notebooks / f"{name}.ipynb").read_text(encoding="utf-8"))["cells"]
        text, pictures, chosen = page(name, cells)
        write(out / f"{name}.md", text.encode())
        for file, content in pictures.items():
            write(out / file, content)
        title, summary = heading(cells)
        shown = f"[![{title}]({chosen})]({name}.md)\n\n" if chosen else ""
        cards.append(f"## [{title}]({name}.md)\n\n{shown}{summary}\n")
    text = "\n".join(["# Notebooks\n", INTRODUCTION, *cards, toctree(names)])
    write(out / "gallery.md", text.encode())


INTRODUCTION = """\
Each notebook runs in about a minute after `pip install '.[notebooks]'`; the files are in the folder
`notebooks` of the source. The pages below show their stored results. In a running notebook the faces
move and can be turned.
"""


def toctree(names: list[str]) -> str:
    """Table of contents of the pages, which is not shown."""
    return "\n".join(["```{toctree}", ":hidden:", "", *names, "```", ""])


def heading(cells: list[dict[str, Any]]) -> tuple[str, str]:
    """Title and first paragraph of a notebook."""
    first = "".join(cells[0]["source"])
    title, _, rest = first.partition("\n")
    return title.lstrip("# "), rest.strip().split("\n\n")[0]


def page(name: str, cells: list[dict[str, Any]]) -> tuple[str, dict[str, bytes], str]:
    """Markdown of a notebook, its pictures by file name, and the picture that stands for it.

    That picture is the first of a cell with the tag "gallery", or else the last of all.
    """
    parts: list[str] = []
    pictures: dict[str, bytes] = {}
    chosen = ""
    for cell in cells:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(source)
            continue
        parts.append(f"```python\n{source}\n```")
        tagged = "gallery" in cell["metadata"].get("tags", [])
        before = len(pictures)
        for output in cell["outputs"]:
            data = output.get("data", {})
            if "image/png" in data:
                file = f"{name}-{len(pictures) + 1}.png"
                pictures[file] = base64.b64decode("".join(data["image/png"]))
                parts.append(f"![{picture_text(data)}]({file})")
            elif "text/html" in data:
                parts.append("```{raw} html\n" + "".join(data["text/html"]).strip() + "\n```")
            else:
                text = "".join(output.get("text") or data.get("text/plain", ""))
                parts.append(f"```text\n{text.rstrip()}\n```")
        if tagged and len(pictures) > before:
            chosen = [*pictures][before]
    return "\n\n".join([*parts, ""]), pictures, chosen or next(reversed(pictures), "")


def picture_text(data: dict[str, Any]) -> str:
    """Alternative text of a picture."""
    text = "".join(data.get("text/plain", ""))
    return (
        "Figure" if text.startswith("<") or not text else text.replace("]", ")").replace("[", "(")
    )


def write(path: Path, content: bytes) -> None:
    """Write a file where its content is new, so that nothing else is built again."""
    if not path.is_file() or path.read_bytes() != content:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)


def _place(name: str) -> tuple[int, str]:
    return (ORDER.index(name) if name in ORDER else len(ORDER)), name


if __name__ == "__main__":
    make()
