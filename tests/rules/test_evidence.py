"""Every table of jaw, tongue, head and sound has a basis on docs/evidence.md, and a verdict if due."""

import re
from pathlib import Path

import pytest

from benchmarks.jaw_published import WANTED
from benchmarks.jaw_verdicts import basis_of, met_of
from emgface.anatomy.jaw.outcomes import EXPECTED_OUTCOMES

DOCS = Path(__file__).parents[2] / "docs"
PAGES = ("jaw", "jaw_published", "tongue", "head", "acoustics/README", "coupled/README")
BASES = {"calibrated", "validated", "free", "computed", "code", "input", "cost", "per row"}


def tables(path: Path) -> list[list[list[str]]]:
    """Tables of a page as rows of cells, with their headings first and without the rule."""
    tables_read, before = [], False
    for line in path.read_text(encoding="utf-8").splitlines():
        inside = line.startswith("|")
        if inside and not re.fullmatch(r"[|\s:-]+", line):
            cells = [cell.strip() for cell in line.strip("|").split("|")]
            if before:
                tables_read[-1].append(cells)
            else:
                tables_read.append([cells])
        before = inside
    return tables_read


def stated() -> dict[tuple[str, str], list[str]]:
    """Basis and note of every table by page and first heading."""
    (rows,) = (t for t in tables(DOCS / "evidence.md") if t[0][:2] == ["page", "table"])
    keys = [(row[0], row[1]) for row in rows[1:]]
    assert len(keys) == len(set(keys)), "a table is listed twice"
    return {key: row[2:] for key, row in zip(keys, rows[1:], strict=True)}


def present() -> set[tuple[str, str]]:
    return {(page, table[0][0]) for page in PAGES for table in tables(DOCS / f"{page}.md")}


def test_every_table_has_a_basis_and_no_basis_lacks_its_table() -> None:
    assert set(stated()) == present()
    assert {basis for basis, _ in stated().values()} <= BASES


def test_tables_that_compare_with_publications_say_with_what_and_with_which_verdict() -> None:
    for key, (basis, note) in stated().items():
        if basis in ("calibrated", "validated", "free", "per row"):
            assert len(note) > 10, key


@pytest.mark.parametrize("page", PAGES)
def test_tables_with_a_basis_or_verdict_per_row_have_one_in_every_row(page: str) -> None:
    for table in tables(DOCS / f"{page}.md"):
        head, rows = table[0], table[1:]
        basis, note = stated()[page, head[0]]
        named = [name for name in ("met", "basis") if f"`{name}`" in note or name in head]
        if basis == "per row":
            assert named, (page, head)
        for name in set(named) & set(head):
            at = head.index(name)
            assert all(row[at] for row in rows), (page, head)
            if name == "basis":
                assert {row[at] for row in rows} <= BASES, (page, head)


def test_the_page_agrees_with_the_basis_of_the_program() -> None:
    """Columns of docs/jaw.md and the table of the command have one source of what was used."""
    (movements,) = (t for t in tables(DOCS / "jaw.md") if t[0][0] == "movement")
    names = {
        "gape, distance of incisal edges": "gape",
        "protrusion": "protrude",
        "laterotrusion": "lateral",
    }
    assert {row[0] for row in movements[1:]} == set(names)
    for row in movements[1:]:
        (one,) = EXPECTED_OUTCOMES[names[row[0]]]
        assert row[-1] == ("calibrated" if one.tuned else "validated")
        assert row[-2] == f"{one.low:g} to {one.high:g}"
        for value in map(float, row[2:4]):
            assert one.low <= value <= one.high


def test_verdicts_on_the_published_jaw_follow_from_its_values() -> None:
    (rows,) = (t for t in tables(DOCS / "jaw_published.md") if t[0][0] == "check")
    names = rows[0][2:-2]
    for check, required, *values, met, basis in rows[1:]:
        assert required == WANTED.get(check, ""), check
        assert met == met_of(required, dict(zip(names, values, strict=True))), check
        assert basis == basis_of(check, required), check


def test_a_bound_a_range_and_a_value_are_read_as_such() -> None:
    assert met_of("20.1 +- 10 %", {"a": "22.1", "b": "22.2", "c": ""}) == "1 of 2"
    assert met_of("35 to 38", {"a": "38", "b": "34.9", "c": "InvertedElement"}) == "1 of 3"
    assert met_of("1e-8", {"a": "2e-9", "b": "-2e-8"}) == "1 of 2"
    assert met_of("at least one of 0.03 to 0.10", {"a": "0.2, 0.1", "b": "none"}) == "1 of 2"
    assert met_of("not published", {"a": "4.1"}) == "-"


@pytest.mark.parametrize(
    ("page", "first", "low", "high"), [("acoustics/README", "tract", 200.0, 500.0)]
)
def test_verdicts_on_thresholds_follow_from_the_published_range(
    page: str, first: str, low: float, high: float
) -> None:
    (rows,) = (t for t in tables(DOCS / f"{page}.md") if t[0][0] == first)
    for row in rows[1:]:
        least, most = map(float, row[2].split(" to "))
        assert row[-1] == ("yes" if low <= least and most <= high else "no"), row
