"""Verdicts on the published numbers of the tasks of a jaw."""

import pytest

from emgface.anatomy.jaw.outcomes import EXPECTED_OUTCOMES, PUBLISHED_OUTCOMES, verdicts
from emgface.anatomy.jaw.tasks import JAW_TASKS

INSIDE = {"end_down": 4.0, "gape": 36.0, "interincisal": 47.0, "forward": 6.0, "lateral": -8.0}


def test_every_published_number_has_a_verdict_and_every_task_a_text() -> None:
    assert set(PUBLISHED_OUTCOMES) == set(JAW_TASKS) and set(EXPECTED_OUTCOMES) <= set(JAW_TASKS)
    for task, text in PUBLISHED_OUTCOMES.items():
        counted = any(word in text for word in (" mm", "20.1"))
        if counted and "larynx" not in text:
            assert task in EXPECTED_OUTCOMES, task


@pytest.mark.parametrize(
    ("task", "value", "said"),
    [
        ("open", 36.0, "gape 36.0: within 35 to 38"),
        ("open", 15.3, "gape 15.3: outside 35 to 38 by -19.7"),
        ("open_head", 35.4, "gape 35.4: outside 50 to 51 by -14.6"),
        ("open_head", 55.0, "gape 55.0: outside 50 to 51 by +4.0"),
        ("open_head", 51.0123, "gape 51.01: outside 50 to 51 by +0.01"),
    ],
)
def test_a_miss_is_stated_with_its_size(task: str, value: float, said: str) -> None:
    verdict, basis = verdicts(task, {"gape": value}, generated=False)
    assert verdict == said and basis.startswith("free")


def test_the_basis_tells_what_was_used_for_the_parameters() -> None:
    """The gape of persons was used for the generated jaw, its laterotrusion was not."""
    assert verdicts("gape", INSIDE, generated=True)[1].startswith("calibrated")
    assert verdicts("gape", INSIDE, generated=False)[1].startswith("validated")
    assert verdicts("lateral", INSIDE, generated=True) == (
        "lateral 8.0: within 7 to 12", "validated: measured in persons, never used",
    )  # fmt: skip
    assert verdicts("clench", INSIDE, generated=True) == ("", "")
