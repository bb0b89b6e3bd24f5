"""Package, citation and changes state one version; the distributions contain what they must."""

import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

from emgface.children import child_environment, python_command


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


def test_the_checks_run_each_slow_test_and_files_that_exist(root: Path) -> None:
    """Slow tests are collected in files that name their mark: one imported from elsewhere hides them."""
    script = (root / ".ci" / "run").read_text(encoding="utf-8")
    mark = re.search(r"grep -rlF (\S+) tests --include='test_\*\.py'", script)
    assert mark is not None and mark[1] == "mark.slow"
    naming = {p for p in (root / "tests").rglob("*.py") if mark[1] in p.read_text(encoding="utf-8")}
    assert naming and all(path.name.startswith("test_") for path in naming)
    named = re.findall(
        r"tests/[\w/.]+", "".join(re.findall(r"^interfaces.*$", script, re.MULTILINE))
    )
    assert len(named) > 5 and all((root / name).exists() for name in named)


def kinds_of_changes(root: Path) -> list[str]:
    return [one["directory"] for one in project(root)["tool"]["towncrier"]["type"]]


def test_every_change_is_a_file_of_one_kind_with_full_sentences(root: Path) -> None:
    kinds = "|".join(kinds_of_changes(root))
    for path in sorted((root / "docs" / "changes").iterdir()):
        if path.name in ("template.md.jinja", ".gitkeep"):
            continue
        assert re.fullmatch(rf"[a-z0-9_-]+\.({kinds})\.md", path.name), path.name
        text = path.read_text(encoding="utf-8")
        assert re.fullmatch(r"[A-Z*`].*[.:]", text.strip(), re.DOTALL), f"{path.name}: sentences"
        assert len(text.strip().splitlines()) <= 4, f"{path.name} is longer than four lines"
        assert "\n#" not in f"\n{text}", f"{path.name} has a heading"


def test_changes_are_assembled_above_those_of_earlier_versions(root: Path, tmp_path: Path) -> None:
    pytest.importorskip("towncrier")
    for name in ("pyproject.toml", "CHANGELOG.md", "docs/changes"):
        source = root / name
        (shutil.copytree if source.is_dir() else shutil.copy)(source, tmp_path / name)
    (tmp_path / "docs" / "changes" / "some-matter.fixed.md").write_text(
        "A matter is repaired,\nand reported.\n"
    )
    subprocess.run(["git", "init", "-q"], cwd=tmp_path, check=True)  # it adds the file to one
    subprocess.run(
        [sys.executable, "-m", "towncrier", "build", "--yes", "--version", "9.0.0"],
        cwd=tmp_path,
        check=True,
        capture_output=True,
    )
    text = (tmp_path / "CHANGELOG.md").read_text(encoding="utf-8")
    headings = re.findall(r"^## (.+)$", text, re.MULTILINE)
    before = re.findall(r"^## (.+)$", (root / "CHANGELOG.md").read_text("utf-8"), re.MULTILINE)
    assert headings == ["9.0.0", *before]
    added = text.partition("## Unreleased")[0]
    assert "- A matter is repaired,\n  and reported.\n" in added.partition("### Fixed\n\n")[2]


@pytest.fixture(scope="module")
def distributions(root: Path, tmp_path_factory) -> tuple[Path, Path, Path]:
    """Wheel, sdist, and the wheel that is built from the sdist."""
    build = pytest.importorskip("hatchling.build")
    out, here = tmp_path_factory.mktemp("dist"), Path.cwd()
    try:
        os.chdir(root)
        wheel, sdist = out / build.build_wheel(str(out)), out / build.build_sdist(str(out))
        with tarfile.open(sdist) as archive:
            archive.extractall(out / "unpacked", filter="data")
        os.chdir(next((out / "unpacked").iterdir()))
        (out / "again").mkdir()
        again = out / "again" / build.build_wheel(str(out / "again"))
    finally:
        os.chdir(here)
    return wheel, sdist, again


def test_the_wheel_contains_every_file_of_the_packages(root: Path, distributions) -> None:
    wheel, _, again = distributions
    names = set(zipfile.ZipFile(wheel).namelist())
    assert names == set(zipfile.ZipFile(again).namelist())
    for package in ("emgface", "sim", "analysis"):
        for path in (root / package).rglob("*"):
            if path.is_file() and "__pycache__" not in path.parts:
                assert path.relative_to(root).as_posix() in names
    for path in (root / "data_schema").glob("*.json"):
        assert f"emgface/_data_schema/{path.name}" in names
    assert not [name for name in names if name.startswith(("tests", "benchmarks", "docs"))]


def test_the_wheel_runs_without_the_source(distributions, tmp_path: Path) -> None:
    zipfile.ZipFile(distributions[0]).extractall(tmp_path / "site")
    search = [str(tmp_path / "site"), *(p for p in sys.path if p.endswith("site-packages"))]
    text = (
        "import emgface, emgface.schema.validation as v, importlib.metadata as m; "
        "print(emgface.__file__, len(v.kinds()), m.version('emgface'))"
    )
    done = subprocess.run(
        python_command("-c", text),
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env=child_environment(search),
    )
    assert done.returncode == 0, done.stderr[-1000:]
    place, kinds, version = done.stdout.split()
    assert place.startswith(str(tmp_path)) and int(kinds) > 5
    assert version in distributions[0].name
