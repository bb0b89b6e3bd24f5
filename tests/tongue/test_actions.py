"""Actions of the muscles of the published tongue, with its variants, and stored shapes."""

from emgface.anatomy.tongue.actions import action, raised_muscles
from emgface.anatomy.tongue.parameters import variant
from emgface.anatomy.tongue.run import simulate_tongue

STEP = 0.02  # s


def moved(tongue, *muscles, name="elements", level=0.3):
    excitation = raised_muscles(*muscles, level=level, duration=0.4)
    p = variant(name, gravity=False)
    motion = simulate_tongue(tongue, excitation, duration=0.4, parameters=p, step=STEP, output=0.1)
    return action(motion)


def test_published_directions_of_the_muscles(published):
    """GGP brings the tip forward, HG moves the back down, SL raises the tip (specification, check 5)."""
    forward, down, up = (moved(published, m) for m in ("bi_GGP", "bi_HG", "SL"))
    assert forward["tip_forward"] > 2.0
    assert down["back_up"] < -2.0
    assert up["tip_up"] > 5.0
    assert min(a["smallest_J"] for a in (forward, down, up)) > 0.0


def test_constant_volumes_are_constant(published):
    """Hard volumes: below 1e-4 (0.01 %) with transversus, which lengthens and narrows the tongue."""
    motion = moved(published, "bi_TRANS", name="lines")
    assert motion["volume_percent"] < 1e-2
    assert motion["longer"] > 0.5
    assert motion["wider"] < -0.5
