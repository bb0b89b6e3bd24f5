"""A jaw driven by sEMG: channels, excitation, score, and the commands."""

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from emgface.anatomy.jaw.emg import excitation_of
from emgface.anatomy.jaw.recorded import score_motion, simulated_recording
from emgface.anatomy.jaw.run import run_excitation, run_task
from emgface.anatomy.jaw.series import excitation_in, read_excitation
from emgface.anatomy.jaw.tasks import JAW_TASKS
from emgface.anatomy.jaw.template import template_jaw
from emgface.choices import configure
from emgface.cli import app
from emgface.errors import JawError, MarkerError, SchemaError, SignalError
from emgface.schema.netcdf import read_netcdf, write_netcdf
from emgface.signals.parameters import SignalChain

STEP = 5e-3
RMS = configure(
    SignalChain,
    {"feature": {"kind": "rms"}, "normalisation": {"outside": "clip"}},
    where="test",
)


@pytest.fixture(scope="module")
def jaw():
    return template_jaw(preset="woman")


@pytest.fixture(scope="module")
def truth(jaw):
    return run_task(jaw, JAW_TASKS["cycles"], step=STEP)


@pytest.fixture(scope="module")
def effort(jaw):
    return simulated_recording(run_task(jaw, JAW_TASKS["effort"], step=STEP), person=3)


@pytest.fixture(scope="module")
def recording(truth):
    return simulated_recording(truth, person=3)


def test_a_simulated_recording_lasts_as_long_as_its_motion(recording, truth):
    """Both clocks start with the motion and end less than a sample before its end."""
    last = float(truth["time"][-1])
    for time in (recording["time_emg"].values, recording["time_marker"].values):
        assert time[0] == float(truth["time"][0])
        assert -1e-9 < last - time[-1] < time[1] - time[0]


def driven(jaw, u):
    return run_excitation(jaw, excitation_in(u), step=STEP)


def renamed(recording, names):
    return recording.assign_coords(
        channel=[names.get(str(c), str(c)) for c in recording["channel"].values]
    )


def test_excitation_follows_the_activation_of_the_recorded_muscles(recording, effort, truth):
    """Normalised by maximum effort, the RMS a of the drive in 0.2 s becomes sqrt(a^2 + n^2) - n.

    n is the noise at rest, relative to maximum effort. The maximum of the reference exceeds its mean by
    the standard deviation of such an RMS, 1 / (2 sqrt(B T)) = 0.11 with a bandwidth B of about 100 Hz.
    """
    excitation = excitation_of(recording, RMS, reference=[effort])
    t = excitation["time"].values + excitation.attrs["recorded_start"]
    window = np.linspace(-0.1, 0.1, 81)
    a = truth["activation"]
    submental = 0.7 * a.sel(muscle="ad_R") + 0.3 * a.sel(muscle="am_R")
    for exciter, channel, drive, plateau in (
        ("t_L", "TEM_L", a.sel(muscle="at_L"), (0.2, 0.5)),
        ("ad_R", "DIG_R", submental, (0.8, 1.1)),
    ):
        signal = effort["emg"].sel(channel=channel)
        rest, full = (float(signal.sel(time_emg=slice(*s)).std()) for s in ((0.0, 0.1), plateau))
        own = np.array([np.mean(np.interp(x + window, truth["time"], drive) ** 2) for x in t])
        expected = np.sqrt(own + (rest / full) ** 2) - rest / full
        u = excitation["excitation"].sel(exciter=exciter).values
        assert np.corrcoef(u, expected)[0, 1] > 0.95
        assert 0.75 < (u @ expected) / (expected @ expected) < 1.1


def test_own_signals_move_the_incisor_and_exchanged_channels_do_not(jaw, recording, effort):
    """The null hypothesis is the same chain with masseter and digastric exchanged."""
    own = score_motion(recording, driven(jaw, excitation_of(recording, RMS, reference=[effort])))
    assert float(own["rho"][0]) > 0.8
    assert 0.7 < float(own["amplitude_ratio"][0]) < 1.4
    exchanged = {f"{a}_{s}": f"{b}_{s}" for a, b in (("MAS", "DIG"), ("DIG", "MAS")) for s in "LR"}
    swapped = [renamed(r, exchanged) for r in (recording, effort)]
    other = score_motion(
        recording, driven(jaw, excitation_of(swapped[0], RMS, reference=swapped[1:]))
    )
    assert not float(other["rho"][0]) > 0.6


def test_sides_and_missing_channels_are_kept_apart(recording):
    """Without the left digastric its exciters are passive, and those of the right unchanged."""
    whole = excitation_of(recording, RMS)
    part = excitation_of(recording.drop_sel(channel="DIG_L"), RMS)
    assert part.attrs["passive"].split() == ["ad_L", "my_L", "ip_L"]
    xr.testing.assert_allclose(
        whole["excitation"].sel(exciter=part["exciter"]), part["excitation"], atol=1e-12
    )
    with pytest.raises(JawError, match=r"channels EMG 1, .* expected TEM_L"):
        excitation_of(
            renamed(
                recording,
                {str(c): f"EMG {k}" for k, c in enumerate(recording["channel"].values, 1)},
            )
        )
    with pytest.raises(JawError, match="expected DIG_L"):
        excitation_of(recording, RMS, reference=[recording.drop_sel(channel="DIG_L")])


def test_a_dead_channel_and_other_units_are_refused(recording, effort):
    dead = recording.copy(deep=True)
    dead["emg"][0] = 0.0
    with pytest.raises(SignalError, match="channel TEM_L holds one value throughout"):
        excitation_of(dead, RMS, reference=[effort])
    loud = recording.assign(emg=1e6 * recording["emg"].assign_attrs(units="V"))
    loud["emg"].attrs["units"] = "V"
    with pytest.raises(JawError, match=r"e\+0\d times as strong .* check the units"):
        excitation_of(loud, RMS, reference=[effort])


def test_time_of_a_recording_that_starts_late_is_kept(jaw, recording):
    """The same recording, started at 100 s, gives the same motion and score."""
    u = excitation_of(recording, RMS)
    late = recording.assign_coords(
        {
            d: (d, recording[d].values + 100.0, recording[d].attrs)
            for d in ("time_emg", "time_marker")
        }
    )
    later = excitation_of(late, RMS)
    np.testing.assert_allclose(later["excitation"], u["excitation"], atol=1e-6)
    assert later.attrs["recorded_start"] == pytest.approx(
        u.attrs["recorded_start"] + 100.0, abs=1e-3
    )
    with pytest.raises(MarkerError, match="expected the recording that drives it"):
        score_motion(recording, driven(jaw, later.isel(time=slice(0, 41))))


def test_commands_go_from_motion_to_score(tmp_path, truth):
    write_netcdf(truth.isel(time=slice(0, 121)), tmp_path / "motion.nc", "jaw_motion")
    write_netcdf(template_jaw(preset="woman"), tmp_path / "jaw.nc", "jaw_model")
    f = {n: str(tmp_path / f"{n}.nc") for n in ("jaw", "motion", "rec", "u", "again", "scores")}
    for command in (
        ["record", f["motion"], "--out", f["rec"], "--person", "3"],
        ["activate", f["rec"], "--out", f["u"], "--feature", "rms", "--band", "20", "400"],
        ["run", f["jaw"], "--excitation", f["u"], "--out", f["again"], "--step", "0.005"],
        ["score", f["rec"], f["again"], "--out", f["scores"]],
    ):
        result = CliRunner().invoke(app, ["jaw", *command])
        assert result.exit_code == 0, result.output
    assert read_netcdf(f["scores"], "scores").attrs["origin"] == "simulated"
    assert '"low":20.0' in read_netcdf(f["u"], "jaw_excitation").attrs["parameters"]
    assert read_excitation(f["u"]).recorded_start == pytest.approx(0.1, abs=1e-3)


def test_recorded_path_of_a_person_is_scored(shared, jaw):
    """The published recording has no sEMG: it can be scored, and activate says what is missing."""
    rows = np.loadtxt(shared / "recordings" / "artisynth-jaw" / "jawPosition.txt", skiprows=2)
    assert rows.shape[1] == 4
    recording = xr.Dataset(
        {"position": (("marker", "axis", "time_marker"), 1e-3 * rows[:, 1:].T[None], {"units": "m"})},
        coords={"marker": ["lower_incisor"], "axis": list("xyz"),
                "time_marker": ("time_marker", rows[:, 0], {"units": "s"})},
        attrs={"origin": "measured"},
    )  # fmt: skip
    motion = run_task(jaw, JAW_TASKS["lateral"], step=STEP)
    scores = score_motion(recording, motion)
    assert -1.0 <= float(scores["rho"][0]) <= 1.0
    assert scores.attrs["origin"] == "measured"
    with pytest.raises(SchemaError, match="expected emg"):
        excitation_of(recording)
    with pytest.raises(MarkerError, match="markers jaw, expected one of"):
        score_motion(recording.assign_coords(marker=["jaw"]), motion)
