"""Package, citation and changes state one version; the distributions contain what they must."""

import re
import tomllib
from pathlib import Path


def project(root: Path) -> dict:
    return tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))


def test_package_citation_and_changes_state_one_version(root: Path) -> None:
    version = project(root)["project"]["version"]
    citation = (root / "CITATION.cff").read_text(encoding="utf-8")
    assert re.search(r"^version: (\S+)$", citation, re.MULTILINE)[1] == version
    headings = re.findall(r"^## (.+)$", (root / "CHANGELOG.md").read_text("utf-8"), re.MULTILINE)
    released = [one for one in headings if one != "Unreleased"]
    assert released[0] == version
    assert headings.index(version) <= 1  # changes that are not released stand above
    assert released == sorted(released, key=lambda one: [-int(n) for n in one.split(".")])


def test_every_package_and_its_data_are_in_the_distributions(root: Path) -> None:
    hatch = project(root)["tool"]["hatch"]["build"]["targets"]
    packages = {path.parent.name for path in root.glob("*/py.typed")}
    assert set(hatch["wheel"]["packages"]) == packages == {"analysis", "emgface", "sim"}
    assert hatch["wheel"]["force-include"] == {"data_schema": "emgface/_data_schema"}
    included = hatch["sdist"]["include"]
    assert {*packages, *hatch["wheel"]["force-include"], "LICENSE"} <= set(included)
    absent = [name for name in included if not (root / name).exists()]
    assert not absent


def test_the_workflow_runs_the_checks_with_the_oldest_and_the_newest_python(root: Path) -> None:
    text = (root / ".github" / "workflows" / "checks.yml").read_text(encoding="utf-8")
    assert "- run: .ci/run" in text
    bounds = project(root)["project"]["requires-python"]
    oldest, after = re.fullmatch(r">=3\.(\d+),<3\.(\d+)", bounds).groups()
    assert f"3.{oldest}\n" in text and f"3.{int(after) - 1}\n" in text
