"""Edited motions: branches from a frame, and their scores."""

import json
import struct
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from analysis.scores import score
from emgface.face.contact_parameters import ContactParameters
from emgface.face.recipe import compose_scene
from emgface.pictures.body import skin_of
from emgface.pictures.encoding import middle_of
from emgface.pictures.surface import SurfaceProbe
from emgface.reduced import training
from emgface.reduced.model import ReducedFace, parameters_of
from emgface.reduced.motion import simulate_reduced
from emgface.run.store import Store
from emgface.schema.netcdf import read_netcdf, write_netcdf
from emgface.view.curves import Curves
from emgface.view.edited import EDITED_OUTPUT, EditedMotion
from emgface.view.motions import Motions
from emgface.view.scored import correlations
from sim import Activation, compile_scene
from sim.reduced import ReducedContact
from sim.reduced.contact import IMPULSES
from tests.reduced.test_face import PARAMETERS, SMALL, short

NOISE = 2e-4


def test_correlations_are_those_of_the_score():
    """Also of markers that stand still, have gaps, or do not exceed their noise."""
    rng = np.random.default_rng(0)
    v, w = np.cumsum(rng.normal(scale=1e-3, size=(2, 6, 3, 40)), axis=3)
    v[1] = 0.01  # stands still
    v[2, :, 20] = np.nan
    w[3] = 0.02
    v[4] = 0.01 + 1e-5 * rng.normal(size=(3, 40))
    v[..., :4] = v[..., 37:] = np.nan
    dims = {"marker": list("abcdef"), "axis": list("xyz"), "time": 0.01 * np.arange(40)}
    given, made = (xr.DataArray(x, dims, tuple(dims), attrs={"units": "m"}) for x in (v, w))
    noise = np.full(6, NOISE)
    whole = xr.Dataset({"position": given, "noise": ("marker", noise, {"units": "m"})})
    options = {"smallest_motion": 1e-9, "smallest_snr": 0.5}
    expected = score(whole, made, **options)["rho"].values
    correlation = correlations(v, w, noise, **options)
    np.testing.assert_array_equal(np.isnan(expected), [False, True, True, True, True, False])
    np.testing.assert_allclose(correlation, expected, atol=1e-12)
    unseen = np.full_like(v, np.nan)
    assert np.isnan(correlations(unseen, w, noise, **options)).all()


@pytest.fixture(scope="module")
def small(coarse, made_once):
    """Reduced face of a short training, the skin of its face, and its centre."""

    def train(folder):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(training, "training_plan", short)
            data = training.reduce_face(coarse, PARAMETERS, SMALL, Store(folder / "motions"))
        write_netcdf(data, folder / "face.rom.nc", "reduced_face")

    data = read_netcdf(made_once("reduced_for_curves", train) / "face.rom.nc", "reduced_face")
    skin = skin_of(coarse)
    centre = middle_of(coarse["position"].values[skin.node])
    return ReducedFace.for_face(data, coarse, parameters_of(data)), skin, centre


def edited(small, **further):
    reduced, skin, centre = small
    return EditedMotion(reduced, skin, centre, step=0.01, **further)


BASE = {
    "ZYG_L": [[0.0, 0.0], [0.3, 0.1], [0.6, 0.0]],
    "OOP_R": [[0.0, 0.0], [0.45, 0.0], [0.5, 0.05]],
}


@pytest.mark.parametrize("interpolation", ["linear", "cubic"])
@pytest.mark.parametrize("step", [0.01, EDITED_OUTPUT, 2 * EDITED_OUTPUT])
def test_a_motion_branches_from_the_last_frame_bit_for_bit(small, interpolation, step):
    """Whatever changes: a late knot, an early one, the duration, nothing; also of previews."""
    reduced, skin, _ = small
    one = Motions(reduced, skin, EDITED_OUTPUT, step)
    late = {**BASE, "OOP_R": [[0.0, 0.0], [0.45, 0.0], [0.5, 0.08]]}
    early = {**BASE, "ZYG_L": [[0.0, 0.0], [0.3, 0.12], [0.6, 0.0]]}
    since = []
    for knots, duration in ((BASE, 0.6), (late, 0.6), (late, 0.6), (late, 0.8), (late, 0.4), (BASE, 0.8),
                            (early, 0.6)):  # fmt: skip
        curves = Curves(knots, duration, interpolation)
        branched = one(curves)
        whole = Motions(reduced, skin, EDITED_OUTPUT, step)(curves)
        assert whole.since == 0.0
        since.append(branched.since)
        for name in ("time", "skin", "markers", "coordinates", "levels", "bound"):
            np.testing.assert_array_equal(getattr(branched, name), getattr(whole, name), name)
    assert since[0] == 0.0 and max(since[1:]) >= 0.3 and since[-1] == 0.0
    if interpolation == "linear":
        assert 0.39 < since[1] <= 0.45 and since[2] == pytest.approx(0.6)


def test_a_face_in_contact_branches_bit_for_bit(small):
    """Steps with contact are taken one by one; their memory is a part of the states that are kept."""
    reduced, skin, _ = small
    parameters = reduced.parameters.model_copy(update={"contact": ContactParameters()})
    whole = compile_scene(compose_scene(reduced.face, parameters)).contact
    modes = reduced.modes.reshape(-1, reduced.modes.shape[2])
    touching = replace(reduced)
    touching.__dict__["contact"] = ReducedContact(whole, reduced.rest, modes)
    late = {**BASE, "OOP_R": [[0.0, 0.0], [0.45, 0.0], [0.5, 0.08]]}
    one = Motions(touching, skin, EDITED_OUTPUT, 0.01)
    one(Curves(BASE, 0.6))
    branched = one(Curves(late, 0.6))
    whole = Motions(touching, skin, EDITED_OUTPUT, 0.01)(Curves(late, 0.6))
    assert branched.since > 0.39 and IMPULSES in one._states[-1].memory
    np.testing.assert_array_equal(branched.coordinates, whole.coordinates)
    np.testing.assert_array_equal(branched.markers, whole.markers)
    apart = Motions(reduced, skin, EDITED_OUTPUT, 0.01)(Curves(late, 0.6)).coordinates
    assert not np.array_equal(whole.coordinates, apart)


def test_a_motion_computed_ahead_is_that_of_its_curves(small):
    """The same positions, forces and bound, also if it was given up at any look."""
    base = Curves(BASE, 0.6)
    late = Curves({**BASE, "OOP_R": [[0.0, 0.0], [0.45, 0.0], [0.5, 0.08]]}, 0.6)
    whole, body = parts(edited(small)(late))
    for looks, ready in ((0, False), (2, False), (99, True)):
        one, asked = edited(small), iter(range(1000))
        one.ahead(late, lambda asked=asked, n=looks: next(asked) >= n)
        assert (one._ready is not None) == ready
        assert next(asked) == min(looks + 1, 6)  # 5 within the motion, and one before the score
        head, rest = parts(one(late))
        assert rest == body
        for name in ("time", "bound", "doubt", "clipped", "forces", "rho"):
            assert head[name] == whole[name], name
        other = parts(one(base))  # what is ready belongs to its curves alone
        assert other[1] == parts(edited(small)(base))[1]


def test_a_failed_motion_ahead_is_reported_when_it_is_asked_for(small, monkeypatch):
    from sim import InvertedElement

    one, curves = edited(small), Curves(BASE, 0.4)

    def fails(*given, **named):
        raise InvertedElement(3, -0.1, 0.2)

    with monkeypatch.context() as patch:
        patch.setattr("emgface.view.motions.Motions.__call__", fails)
        one.ahead(curves, lambda: False)
        with pytest.raises(InvertedElement):
            one(curves)
    assert parts(one(curves))[1] == parts(edited(small)(curves))[1]


def test_previews_use_the_alignment_of_the_last_motion_that_was_asked_for(small):
    """Not of one that was computed ahead."""
    from types import SimpleNamespace

    one, curves = edited(small), Curves(BASE, 0.4)

    class Scorer(SimpleNamespace):
        def __call__(self, motion):
            self.aligned = None if self.aligned is None else "ahead"
            return {"rho": {}}

        def preview(self, markers, position):
            return {"rho": {"used": self.aligned}}

    one._scorer = Scorer(aligned="former")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("emgface.view.edited.measured_markers", lambda *given: np.zeros((1, 1, 3)))
        one.ahead(curves, lambda: False)
        assert parts(one(curves, preview=True))[0]["rho"] == {"used": "former"}
        one(curves)
        assert parts(one(curves, preview=True))[0]["rho"] == {"used": "ahead"}


def test_curves_are_the_same_only_with_equal_knots_and_times():
    one = Curves(BASE, 0.6)
    assert one.same(Curves({**BASE}, 0.6))
    changed = {**BASE, "ZYG_L": [[0.0, 0.0], [0.3, 0.12], [0.6, 0.0]]}
    for other in (Curves(BASE, 0.5), Curves(BASE, 0.6, "cubic"), Curves(changed, 0.6),
                  Curves({"ZYG_L": BASE["ZYG_L"]}, 0.6)):  # fmt: skip
        assert not one.same(other) and not other.same(one)


@pytest.mark.parametrize("step", [0.01, 2 * EDITED_OUTPUT])
def test_a_motion_is_that_of_the_reduced_face(small, step):
    """At the ends of its steps; previews have the mean of two steps between them."""
    reduced, skin, _ = small
    late = {**BASE, "OOP_R": [[0.0, 0.0], [0.45, 0.0], [0.5, 0.08]]}
    motions = Motions(reduced, skin, EDITED_OUTPUT, step)
    for knots, duration in ((BASE, 0.6), (late, 0.6), (late, 0.82), (late, 0.1)):
        curves = Curves(knots, duration)
        motion, frames = motions(curves), round(duration / EDITED_OUTPUT) + 1
        np.testing.assert_allclose(motion.time, EDITED_OUTPUT * np.arange(frames))
        activation = Activation(*curves.activation(reduced.model.system.muscles))
        every = 2 if step > EDITED_OUTPUT else 1
        count = (frames - 1) // every
        expected = simulate_reduced(
            reduced, activation, count * every * EDITED_OUTPUT, step=step, output=every * EDITED_OUTPUT,
            further=(SurfaceProbe(skin.node),),
        )  # fmt: skip
        for values, name, node in ((motion.markers, "position", "marker"),
                                   (motion.skin, "surface_position", "surface_node")):  # fmt: skip
            given = expected[name].transpose("time", node, "axis").values
            assert len(values) == frames
            np.testing.assert_allclose(values[::every][: count + 1], given, rtol=0.0, atol=1e-9)
            if every == 2:
                ends, middle = values[: 2 * count + 1 : 2], values[1 : 2 * count : 2]
                np.testing.assert_allclose(
                    middle, 0.5 * (ends[1:] + ends[:-1]), rtol=0.0, atol=1e-12
                )
        if frames % every or every == 1:
            assert motion.bound == pytest.approx(float(expected["reduction_error"].max()), rel=1e-9)


def test_a_preview_is_scored_and_doubted_as_the_complete_motion(small):
    """The message of a preview differs from that of the motion by its steps only."""
    one = edited(small)
    curves = Curves(BASE, 0.6)
    complete, preview = (parts(one(curves, preview=p)) for p in (False, True))
    assert preview[0]["preview"] and not complete[0]["preview"]
    assert preview[0]["time"] == complete[0]["time"] and len(preview[1]) == len(complete[1])
    assert preview[0]["doubt"] == complete[0]["doubt"]
    apart = np.frombuffer(preview[1], "<i2").astype(int) - np.frombuffer(complete[1], "<i2")
    moved = np.frombuffer(complete[1], "<i2").astype(int)
    assert 0 < np.abs(apart).max() < 0.2 * np.ptp(moved.reshape(-1)[: len(moved)])


def test_forces_are_those_of_the_changed_curves(small):
    """After a changed knot, also where the motion branches; a preview has none."""
    one, muscles = edited(small), list(small[0].model.system.muscles)
    before = parts(one(Curves(BASE, 0.6)))[0]["forces"]
    late = Curves({**BASE, "OOP_R": [[0.0, 0.0], [0.45, 0.0], [0.5, 0.2]]}, 0.6)
    assert parts(one(late, preview=True))[0]["forces"] is None
    head = parts(one(late))[0]
    assert head["branched"] > 0.3
    anew = parts(edited(small)(late))[0]["forces"]
    assert head["forces"] == anew != before
    # A small passive force at rest, by gravity, and then nearly in proportion to the activation.
    k, time = muscles.index("OOP_R"), np.array(head["time"])
    forces, level = np.array(anew)[:, k], late.at("OOP_R", time)
    assert abs(forces[0]) < 0.01 * forces.max() and np.corrcoef(forces, level)[0, 1] > 0.99


def test_a_failed_motion_leaves_the_former_one(small):
    from sim import InvertedElement

    one, curves = edited(small), Curves(BASE, 0.4)
    expected = one(curves)
    sides = [f"{m}_{side}" for m in ("OOP", "ZYG", "DAO", "LLSAN", "MEN") for side in "LR"]
    violent = dict.fromkeys(sides, [[0.0, 0.0], [0.2, 0.0], [0.21, 1.0]])
    try:
        one(Curves(violent, 0.4))
    except InvertedElement:
        pass
    again = one(curves)
    head, body = parts(again)
    assert body == parts(expected)[1] and head["bound"] == parts(expected)[0]["bound"]


def parts(message):
    (size,) = struct.unpack("<I", message[:4])
    return json.loads(message[4 : 4 + size]), message[4 + size :]
