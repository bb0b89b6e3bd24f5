"""Numbers in sentences of the README, compared with stored measurements and with the code."""

import csv
import re

from emgface.face.event_error import ASSUMED

NAMES = "three four five six seven eight nine ten eleven twelve".split()
FOLD = {number: f"{name}fold" for number, name in enumerate(NAMES, 3)}


def test_the_price_of_contact_is_that_of_the_stored_run_times(root):
    text = " ".join((root / "README.md").read_text("utf-8").split())
    with (root / "benchmarks" / "speed.csv").open(encoding="utf-8") as f:
        times = {row["case"]: float(row["median U"]) for row in csv.DictReader(f)}
    ratio = times["study preset, 10 ms, with contact"] / times["study preset, 10 ms"]
    assert f"increases the run time of a simulation about {FOLD[round(ratio)]}" in text


def test_the_error_of_contact_is_the_one_that_motions_report(root):
    text = " ".join((root / "README.md").read_text("utf-8").split())
    results = re.search(r"the error of a lip marker .* may reach ([0-9.]+) mm", text)
    assert results is not None
    assert float(results[1]) == 1e3 * ASSUMED
