"""The page on the solution of a step and the code refer to the same equations."""

import re


def test_equations_of_the_step_page_are_those_of_the_code(root):
    page = (root / "docs" / "step.md").read_text()
    declared = [int(k) for k in re.findall(r"^\*\*\((\d+)\)", page, re.M)]
    assert declared == list(range(1, len(declared) + 1))
    used = dict[int, list[str]]()
    for path in (root / "sim").rglob("*.py"):
        text = path.read_text()
        if "docs/step.md" in text:
            number = re.compile(r"\((\d+)\)(?:[^()]{0,40}\((\d+)\))?[^()]{0,60}docs/step\.md")
            for match in number.findall(text):
                for k in filter(None, match):
                    used.setdefault(int(k), []).append(path.name)
    assert set(used) == set(declared), "numbers of the page that no docstring names, or others"
    for name in set(re.findall(r"`([\w/]+\.py)`", page)):
        match = [p for p in (root / "sim").rglob("*.py") if p.as_posix().endswith(f"/{name}")]
        assert match, f"the page names {name}, which does not exist"
