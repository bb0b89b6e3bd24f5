"""Head motion: rigid motion is removed up to rounding; dropouts are bridged or reported."""

import numpy as np
import pytest
import xarray as xr
from scipy.spatial.transform import Rotation

from emgface.errors import MarkerError, SignalError, UnitsError
from emgface.muscles import AXES, FACE_MARKERS, LIP_MARKERS
from emgface.recordings.head import in_head_frame
from emgface.signals.parameters import HeadFrameParameters

NAMES = [*FACE_MARKERS, *LIP_MARKERS]
FACE = np.array(
    [
        [-0.04, 0.08, 0.11],
        [0.04, 0.08, 0.11],
        [-0.07, 0.02, 0.08],
        [0.07, 0.02, 0.08],
        [0.0, 0.10, 0.07],
        [0.0, 0.12, 0.04],
    ]
)
PARAMETERS = HeadFrameParameters()
FRAMES = 120


def still_face_moving_lips() -> np.ndarray:
    """Positions (frame, marker, axis) in the frame of the head."""
    t = np.arange(FRAMES) / 100.0
    lips = np.random.default_rng(2).uniform(-0.03, 0.03, (10, 3)) + [0.0, 0.11, 0.0]
    motion = 0.01 * np.sin(2 * np.pi * t)[:, None, None] * [1.0, 0.5, -0.3]
    return np.concatenate([np.broadcast_to(FACE, (FRAMES, 6, 3)), lips + motion], axis=1)


def positions_of(values) -> xr.DataArray:
    return xr.DataArray(
        np.asarray(values).transpose(1, 2, 0),
        dims=("marker", "axis", "time_marker"),
        coords={
            "marker": NAMES,
            "axis": list(AXES),
            "time_marker": np.arange(len(values)) / 100.0,
        },
        attrs={"units": "m"},
    )


def head_motion(values) -> np.ndarray:
    """Turn by up to a quarter circle and shift by decimetres."""
    t = np.arange(len(values)) / 100.0
    turn = Rotation.from_rotvec(np.stack([1.5 * np.sin(t), 0.4 * t, -0.7 * np.cos(3 * t)], 1))
    shift = np.stack([0.3 * t, 0.1 * np.sin(t), 1.0 + 0 * t], axis=1)
    return np.einsum("tij,tmj->tmi", turn.as_matrix(), values) + shift[:, None]


def reference() -> xr.DataArray:
    return xr.DataArray(
        FACE,
        dims=("face_marker", "axis"),
        coords={"face_marker": list(FACE_MARKERS), "axis": list(AXES)},
        attrs={"units": "m"},
    )


def frames_of(result) -> np.ndarray:
    return result.values.transpose(2, 0, 1)


def test_rigid_motion_is_removed_to_rounding():
    truth = still_face_moving_lips()
    result = in_head_frame(positions_of(head_motion(truth)), PARAMETERS, reference())
    assert np.abs(frames_of(result) - truth).max() < 1e-12
    assert result.attrs["residual_max"] < 1e-12 and result.attrs["head_reference"] == "given"


@pytest.mark.parametrize("own", ["first", "mean"])
def test_own_reference_gives_the_frame_of_the_first_frame(own):
    truth = still_face_moving_lips()
    moved = head_motion(truth)
    result = in_head_frame(positions_of(moved), HeadFrameParameters(own_reference=own))
    # Everything is expressed in the head's pose of frame 0.
    turn = Rotation.align_vectors(moved[0, :6] - moved[0, :6].mean(0), FACE - FACE.mean(0))[0]
    expected = turn.apply((truth - FACE.mean(0)).reshape(-1, 3)).reshape(truth.shape)
    expected += moved[0, :6].mean(0)
    assert np.abs(frames_of(result) - expected).max() < 1e-12


def test_rotation_equals_an_independent_least_squares_fit():
    """Noisy markers, against scipy's Rotation.align_vectors frame by frame.

    Each frame is fitted to the mean configuration of the trial, and that to the reference.
    """
    rng = np.random.default_rng(4)
    moved = head_motion(still_face_moving_lips()) + 1e-3 * rng.standard_normal((FRAMES, 16, 3))
    result = frames_of(in_head_frame(positions_of(moved), PARAMETERS, reference()))

    def onto(target: np.ndarray, points: np.ndarray, also: np.ndarray) -> np.ndarray:
        turn, _ = Rotation.align_vectors(target - target.mean(0), points - points.mean(0))
        return turn.apply(also - points.mean(0)) + target.mean(0)

    mean = np.mean([onto(moved[0, :6], frame[:6], frame[:6]) for frame in moved], axis=0)
    target = onto(FACE, mean, mean)
    for k in range(0, FRAMES, 7):
        expected = onto(target, moved[k, :6], moved[k])
        np.testing.assert_allclose(result[k], expected, atol=1e-12)
    squares = np.sum((result[:, :6] - FACE) ** 2, axis=2)
    attrs = in_head_frame(positions_of(moved), PARAMETERS, reference()).attrs
    assert attrs["residual_rms"] == pytest.approx(np.sqrt(squares.mean()), rel=1e-12)
    assert attrs["residual_max"] == pytest.approx(np.sqrt(squares.max()), rel=1e-12)


@pytest.mark.parametrize("lost", range(6))
def test_a_dropout_causes_no_jump_if_head_and_reference_differ_in_shape(lost):
    """With a difference in shape of six millimetres, the lips of a head at rest must not jump."""
    truth = still_face_moving_lips()
    truth[:, :6] += 6e-3 * np.random.default_rng(8).standard_normal((6, 3))
    whole = head_motion(truth)
    holed = whole.copy()
    holed[40:80, lost] = np.nan
    expected, result = (
        frames_of(in_head_frame(positions_of(values), PARAMETERS, reference()))
        for values in (whole, holed)
    )
    assert np.abs(result[:, 6:] - expected[:, 6:]).max() < 1e-12


def test_mean_reference_averages_the_noise_of_the_first_frame():
    rng = np.random.default_rng(5)
    moved = head_motion(still_face_moving_lips())
    moved[:, :6] += 1e-3 * rng.standard_normal((FRAMES, 6, 3))
    rms = {
        own: in_head_frame(positions_of(moved), HeadFrameParameters(own_reference=own)).attrs[
            "residual_rms"
        ]
        for own in ("first", "mean")
    }
    # Noise of the reference adds to that of each frame: a factor of sqrt(2) for one frame.
    assert rms["first"] / rms["mean"] == pytest.approx(np.sqrt(2), rel=0.25)


def test_planar_face_markers_do_not_mirror_the_lips():
    flat = FACE.copy()
    flat[:, 1] = 0.05
    truth = still_face_moving_lips()
    truth[:, :6] = flat
    given = reference().copy(data=flat)
    result = in_head_frame(positions_of(head_motion(truth)), PARAMETERS, given)
    assert np.abs(frames_of(result) - truth).max() < 1e-12


def test_lost_face_markers_are_left_out_exactly():
    truth = still_face_moving_lips()
    moved = head_motion(truth)
    moved[40:43, 0] = np.nan  # short
    moved[60:100, 2, 1] = np.nan  # long, one coordinate only
    moved[:, 5] = np.nan  # throughout
    result = in_head_frame(positions_of(moved), PARAMETERS, reference())
    lips = frames_of(result)[:, 6:]
    assert np.abs(lips - truth[:, 6:]).max() < 1e-12
    left_out = result.attrs["face_markers_left_out"].split()
    assert left_out == ["forehead_left", "temple_left", "rhinion"]
    assert np.abs(frames_of(result)[:, 0] - FACE[0]).max() < 1e-12  # bridged at rest
    assert result.attrs["bridged"] == 3


def test_short_dropout_of_a_lip_marker_is_bridged_in_the_head_frame():
    """Cubic through a sine of 1 Hz, 5 frames of 10 ms lost; the head moves 50 times as far."""
    truth = still_face_moving_lips()
    moved = head_motion(truth)
    moved[70:75, 9] = np.nan
    result = in_head_frame(positions_of(moved), PARAMETERS, reference())
    error = np.abs(frames_of(result) - truth)
    assert error[70:75, 9].max() < 1e-4 and np.delete(error, 9, axis=1).max() < 1e-12
    assert result.attrs["bridged"] == 5


def test_long_dropout_of_a_lip_marker_is_named():
    moved = head_motion(still_face_moving_lips())
    moved[30:41, 6] = np.nan
    with pytest.raises(
        MarkerError, match=r"corner_left is lost for 0.11 s \(11 frames\) from t = 0.3 s"
    ):
        in_head_frame(positions_of(moved), PARAMETERS, reference())
    relaxed = HeadFrameParameters(max_gap=0.11)
    assert np.isfinite(in_head_frame(positions_of(moved), relaxed, reference()).values).all()


@pytest.mark.parametrize("frames", [slice(0, 2), slice(-2, None)])
def test_a_dropout_at_an_end_is_not_filled_and_the_rest_is_kept(frames):
    truth = still_face_moving_lips()
    moved = head_motion(truth)
    moved[frames, 7] = np.nan
    moved[30:33, 7] = np.nan  # a gap between frames is interpolated as before
    result = frames_of(in_head_frame(positions_of(moved), PARAMETERS, reference()))
    lost = np.isnan(result[:, 7, 0])
    assert np.flatnonzero(lost).tolist() == np.arange(FRAMES)[frames].tolist()
    kept = np.delete(np.arange(16), 7)
    np.testing.assert_allclose(result[:, kept], truth[:, kept], atol=1e-14)


def test_a_marker_that_is_never_visible():
    moved = head_motion(still_face_moving_lips())
    moved[:, 7] = np.nan
    with pytest.raises(MarkerError, match="upper_lateral_left is never visible"):
        in_head_frame(positions_of(moved), PARAMETERS, reference())


def test_head_that_cannot_be_placed_at_an_end_leaves_the_rest():
    truth = still_face_moving_lips()
    moved = head_motion(truth)
    moved[:10, :4] = np.nan
    result = frames_of(in_head_frame(positions_of(moved), PARAMETERS, reference()))
    assert np.isnan(result[:10]).all()
    np.testing.assert_allclose(result[10:], truth[10:], atol=1e-14)


def test_fewer_than_three_face_markers():
    moved = head_motion(still_face_moving_lips())
    moved[50:60, :4] = np.nan
    with pytest.raises(
        MarkerError,
        match=r"only 2 face markers .* t = 0.5 s for 0.1 s \(10 frames; lost: forehead_left, "
        "forehead_right, temple_left, temple_right",
    ):
        in_head_frame(positions_of(moved), PARAMETERS, reference())


def test_collinear_face_markers():
    truth = still_face_moving_lips()
    truth[:, 1] = 0.5 * (FACE[0] + FACE[4])
    moved = head_motion(truth)
    moved[100:110, [2, 3, 5]] = np.nan  # leaves three on one line
    with pytest.raises(MarkerError, match=r"3 face markers present lie on one line at t = 1 s"):
        in_head_frame(positions_of(moved), PARAMETERS)
    line = reference().copy(data=np.linspace([0, 0, 0], [1, 1, 1], 6))
    with pytest.raises(MarkerError, match="reference lie on one line"):
        in_head_frame(positions_of(head_motion(still_face_moving_lips())), PARAMETERS, line)


def test_frame_that_shares_too_few_markers_with_the_own_reference():
    moved = head_motion(still_face_moving_lips())
    moved[:, 5] = np.nan
    moved[50, [0, 1, 2]] = np.nan
    moved[50, 5] = [0.0, 0.0, 0.0]  # three present, one of them unknown to frame 0
    for own in ("first", "mean"):
        with pytest.raises(MarkerError, match=r"only 2 face markers .* t = 0.5 s"):
            in_head_frame(positions_of(moved), HeadFrameParameters(own_reference=own))


def test_missing_markers_are_named():
    positions = positions_of(still_face_moving_lips())
    with pytest.raises(MarkerError, match="missing markers nasion, corner_right "):
        in_head_frame(positions.drop_sel(marker=["nasion", "corner_right"]), PARAMETERS)
    with pytest.raises(MarkerError, match="reference lacks the face markers rhinion "):
        in_head_frame(positions, PARAMETERS, reference().isel(face_marker=slice(0, 5)))


def test_units_dims_and_sampling():
    positions = positions_of(still_face_moving_lips())
    with pytest.raises(UnitsError, match="'mm', expected 'm'"):
        in_head_frame(positions.assign_attrs(units="mm"), PARAMETERS)
    with pytest.raises(UnitsError, match="reference has units"):
        in_head_frame(positions, PARAMETERS, reference().assign_attrs(units="mm"))
    with pytest.raises(MarkerError, match="expected marker, axis, time_marker"):
        in_head_frame(positions.isel(axis=0), PARAMETERS)
    with pytest.raises(SignalError, match="not uniform"):
        in_head_frame(positions.isel(time_marker=[0, 1, 2, 5, 6]), PARAMETERS)


def test_order_of_markers_and_axes_does_not_matter():
    moved = positions_of(head_motion(still_face_moving_lips()))
    straight = in_head_frame(moved, PARAMETERS, reference())
    shuffled = moved.isel(marker=np.random.default_rng(0).permutation(16)).transpose(
        "time_marker", "axis", "marker"
    )
    again = in_head_frame(shuffled, PARAMETERS, reference().isel(face_marker=[5, 4, 3, 2, 1, 0]))
    assert again.dims == straight.dims
    np.testing.assert_allclose(again.sel(marker=NAMES).values, straight.values, atol=1e-14)


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_mirrored_axes_are_refused(axis):
    values = still_face_moving_lips()
    values[:, :, AXES.index(axis)] *= -1.0
    moved = positions_of(head_motion(values))
    with pytest.raises(MarkerError, match="left and right are exchanged in the names, or one axis"):
        in_head_frame(moved, PARAMETERS, reference())
    in_head_frame(moved, PARAMETERS)  # without a reference nothing tells left from right


@pytest.mark.parametrize("factor", [1e3, 1e-3])
def test_a_wrong_unit_is_recognised_by_the_size_of_the_head(factor):
    moved = positions_of(head_motion(still_face_moving_lips() * factor))
    with pytest.raises(UnitsError, match="check the unit of the positions"):
        in_head_frame(moved, PARAMETERS, reference())


def test_another_head_of_the_same_hand_is_accepted():
    values = still_face_moving_lips() * [1.2, 0.85, 1.1]
    in_head_frame(positions_of(head_motion(values)), PARAMETERS, reference())
