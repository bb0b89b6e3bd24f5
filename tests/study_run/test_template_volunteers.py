"""Volunteers that contribute to a template: few, the same in every run, never the person."""

from emgface.study.baselines import MOST_OTHERS, _others


def test_a_template_takes_a_limited_number_of_other_volunteers() -> None:
    names = [f"S{k:03d}" for k in range(200)]
    typical = {(name, i): f"{name}{i}" for name in names for i in "AB"}
    taken = {name: _others(name, typical) for name in names}
    for name, found in taken.items():
        assert len(found) == 2 * MOST_OTHERS and all(p[0] != name for p in found)
    assert _others("S007", dict(reversed(typical.items()))) == taken["S007"]
    assert len({frozenset(found) for found in taken.values()}) == len(names)


def test_a_small_study_takes_all_other_volunteers() -> None:
    typical = {(f"S{k}", "A"): str(k) for k in range(6)}
    assert _others("S2", typical) == {p: d for p, d in typical.items() if p[0] != "S2"}
