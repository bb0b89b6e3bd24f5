"""Area functions of tables, surfaces and lips; their sound, files and commands."""

import numpy as np
import pytest
import xarray as xr
from scipy.io import wavfile

from benchmarks.acoustic_shapes import BENT, STRAIGHT, pipe, published_airway
from emgface.acoustics import CLOSURE_AREA
from emgface.acoustics.errors import AcousticsError
from emgface.anatomy.airway.area_function import (
    area_function,
    areas_of_surface,
    ideal_vowel,
    lips_of_trial,
    read_areas,
    with_lips,
)
from emgface.anatomy.airway.figure import write_sound_figure
from emgface.anatomy.airway.muscles import formants_by_muscle
from emgface.anatomy.airway.sections import centre_line, sections
from emgface.anatomy.airway.sound import source_of, synthesise, with_formants, write_wave
from emgface.errors import ConfigurationError, DataError
from emgface.face.contact_parameters import NO_CONTACT
from emgface.face.lip_shape import lip_rim, lip_shape
from emgface.face.mouth import Mouth
from emgface.face.simulation_parameters import SimulationParameters
from emgface.schema.netcdf import read_netcdf, write_netcdf


@pytest.mark.parametrize(("line", "flat"), [(STRAIGHT, 1.0), (BENT, 1.0), (STRAIGHT, 0.3)])
def test_area_and_length_of_known_tubes(line, flat):
    s = np.append(0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))
    radius = 0.008 + 0.003 * np.sin(40 * s)
    position, triangle = pipe(line, radius, flat=flat)
    airway = sections(position, triangle, line, count=40)
    middle = (np.arange(40) + 0.5) / 40 * s[-1]
    expected = np.pi * flat * (0.008 + 0.003 * np.sin(40 * middle)) ** 2
    assert airway.area == pytest.approx(expected, rel=0.01)
    assert airway.length == pytest.approx(s[-1], rel=0.01)


def test_a_centre_line_is_found_and_moves_with_the_body():
    position, triangle = pipe(BENT, 0.008)
    line = centre_line(position, triangle, BENT[0], levels=20)
    airway = sections(position, triangle, line, count=30, rounds=4)
    assert airway.area[2:-2] == pytest.approx(np.pi * 0.008**2, rel=0.01)
    turn = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))[0]
    shift = np.array([1.0, -2.0, 0.5])
    moved = sections(position @ turn.T + shift, triangle, line @ turn.T + shift, count=30, rounds=4)
    assert moved.area == pytest.approx(airway.area, rel=1e-9)
    assert moved.length == pytest.approx(airway.length, rel=1e-9)


@pytest.mark.parametrize("angle", [0.5 * np.pi, np.pi])
@pytest.mark.parametrize("with_end", [True, False])
def test_areas_of_bent_tubes_are_right_up_to_their_open_ends(angle, with_end, tmp_path):
    """Rings at equal distance from the start ended on one side of the tube: areas were 92 % wrong."""
    at = np.linspace(0.0, angle, 160)
    line = 0.03 * np.stack([np.sin(at), 0.0 * at, 1.0 - np.cos(at)], axis=1)
    radius = 0.008 + 0.003 * np.sin(6.0 * at)
    position, triangle = pipe(line, radius)
    path = tmp_path / "pipe.obj"
    rows = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in position]
    path.write_text("\n".join([*rows, *(f"f {a} {b} {c}" for a, b, c in triangle + 1)]))
    start = line[0] + [0.0, 0.004, 0.0]  # not in the middle of the rim
    sections = areas_of_surface(path, start, end=line[-1] if with_end else None)
    expected = np.pi * np.interp((np.arange(40) + 0.5) / 40, at / angle, radius) ** 2
    assert sections["area"].values[0] == pytest.approx(expected, rel=0.01)
    assert sections["length"].values[0] == pytest.approx(0.03 * angle, rel=0.01)


def test_a_centre_line_needs_rings_between_its_ends():
    position, triangle = pipe(BENT, 0.008)
    with pytest.raises(DataError, match="no rings between the points"):
        centre_line(position, triangle, BENT[0], end=BENT[0])


def test_the_published_airway_is_of_adult_length_and_keeps_it_in_rigid_motion(shared):
    """Skin of the tract of one speaker, without its lips, which continue over the face."""
    position, triangle, line = published_airway(shared)
    airway = sections(position, triangle, line, count=30)
    assert 0.15 < airway.length < 0.18
    assert ((airway.area[1:] > 0.3e-4) & (airway.area[1:] < 6e-4)).all()
    turn = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))[0]
    moved = sections(position @ turn.T + 1.0, triangle, line @ turn.T + 1.0, count=30)
    assert moved.area == pytest.approx(airway.area, rel=1e-9, abs=1e-15)
    assert moved.length == pytest.approx(airway.length, rel=1e-9)


def test_other_walls_and_closures():
    position, triangle = pipe(STRAIGHT, 0.008)
    outer, more = pipe(STRAIGHT, 0.02)
    both = np.concatenate([position, outer]), np.concatenate([triangle, more + len(position)])
    assert sections(*both, STRAIGHT).area == pytest.approx(np.pi * 0.008**2, rel=0.01)
    flipped = sections(position, triangle[:, ::-1], STRAIGHT).area
    assert flipped == pytest.approx(np.pi * 0.008**2, rel=0.01)
    closed = position * np.where(np.abs(position[:, :1] - 0.1) < 0.01, [1.0, 0.0, 0.0], 1.0)
    area = sections(closed, triangle, STRAIGHT, count=34).area
    assert (area[19:21] == 0.0).all() and (area[:17] > 1e-4).all()
    with pytest.raises(DataError, match="the length zero"):
        sections(position, triangle, STRAIGHT[:1])
    with pytest.raises(DataError, match="no plane"):
        sections(position, triangle, STRAIGHT + 1.0)
    with pytest.raises(DataError, match="empty"):
        centre_line(position, triangle[:0], STRAIGHT[0])


TABLE = "label,A0_cm2,A1_cm2,A2_cm2,length_m\nfirst,1,2,3,0.17\nsecond,4,5,6,0.16\n"


def test_tables_of_areas(tmp_path):
    path = tmp_path / "areas.csv"
    path.write_text(TABLE)
    areas = read_areas(path, "second")
    assert areas["area"].values == pytest.approx(np.array([[4e-4, 5e-4, 6e-4]]))
    assert float(areas["length"][0]) == 0.16
    back = read_areas(path, "second", from_lips=True)
    assert back["area"].values == pytest.approx(areas["area"].values[:, ::-1])
    path.write_text("time_s,A0_cm2,A1_cm2,length_m\n0,1,2,0.17\n0.1,1,0,0.17\n")
    assert read_areas(path).sizes == {"time": 2, "section": 2}


@pytest.mark.parametrize(
    ("text", "row", "words"),
    [
        (TABLE, None, "2 rows"),
        (TABLE, "third", "0 rows 'third'"),
        ("x,y\n1,2\n", None, "A0_cm2"),
        ("A0_cm2,length_m\n-1,0.17\n", None, "negative"),
        ("A0_cm2,A1_cm2,length_m\n1e-4,3e-4,0.17\n", None, "areas up to 0.0003 cm2"),
        ("", None, "cannot be read"),
    ],
)
def test_unusable_tables_are_refused(tmp_path, text, row, words):
    path = tmp_path / "areas.csv"
    path.write_text(text)
    with pytest.raises(DataError, match=words):
        read_areas(path, row)


def test_idealised_vowels_have_the_formants_of_their_names():
    f = {name: with_formants(ideal_vowel(name))["formant_frequency"].values[0] for name in "aiu"}
    assert f["a"][0] > 600.0 > 400.0 > max(f["i"][0], f["u"][0])
    assert f["i"][1] > 1900.0 > 1300.0 > f["a"][1] > f["u"][1]
    with pytest.raises(DataError, match="unknown vowel"):
        ideal_vowel("x")


def test_rounding_lips_lower_the_formants():
    areas, forward = np.array([2e-4, 0.5e-4, 0.5e-4, 0.0]), np.array([0.0, 0.0, 0.006, 0.0])
    tract = with_lips(ideal_vowel("u"), areas, forward, np.arange(4) * 0.1)
    assert tract["area"].values[:, -1] == pytest.approx(np.maximum(areas, CLOSURE_AREA))
    assert tract["length"].values == pytest.approx(0.17 + forward)
    f = with_formants(tract)["formant_frequency"].values
    assert f[0, 0] > f[1, 0] > f[2, 0] and f[0, 1] > f[1, 1] > f[2, 1]
    assert np.isfinite(f[3, 0])  # closed lips: the resonance of walls and air
    assert "only the lips move" in tract.attrs["assumptions"]


def test_the_opening_of_the_mouth_is_what_one_sees_through_it(coarse):
    """Less than between the margins; it grows by the width times a shift and ends at closure."""
    mouth, rim, rest = Mouth.from_face(coarse), lip_rim(coarse), coarse["position"].values
    area, forward = mouth.measure(rest)
    assert 0.0 < area < lip_shape(coarse, rim, rest)["area"] and forward == 0.0
    upper = np.setdiff1d(mouth.upper, mouth.lower)
    moved = rest.copy()
    moved[upper] += [0.0, 0.0, 0.003]
    moved[mouth.margins, 1] += 0.004
    opened, forward = mouth.measure(moved)
    width = np.ptp(rest[mouth.corners, 0])
    assert opened - area == pytest.approx(0.003 * width, rel=0.1)
    assert forward == pytest.approx(0.004)
    moved[upper] -= [0.0, 0.0, 0.008]
    assert mouth.measure(moved)[0] < 0.02 * area
    assert mouth.measure(rest + [0.1, 0.2, 0.3])[0] == pytest.approx(area)


def test_the_lips_of_a_trajectory_are_interpolated():
    motion = xr.Dataset(
        {"mouth_area": ("time", [1e-4, 2e-4]), "lip_protrusion": ("time", [0.0, 0.004])},
        {"time": [0.0, 0.1]},
    )
    area, forward, time = lips_of_trial(motion)
    assert time == pytest.approx(np.linspace(0.0, 0.1, 11)) and (np.diff(forward) > 0.0).all()
    assert area[[0, -1]] == pytest.approx([1e-4, 2e-4]) and forward[-1] == pytest.approx(0.004)
    with pytest.raises(DataError, match="no mouth_area"):
        lips_of_trial(motion.drop_vars("mouth_area"))


def test_muscles_change_formants_by_the_lips(coarse):
    """Depressors of the lower lip open the mouth, which raises both formants of an /u/."""
    free = SimulationParameters(gravity=False, contact=NO_CONTACT, sigma_max=1e5)
    table = formants_by_muscle(coarse, ideal_vowel("u"), muscles=("DLI",), parameters=free)
    rest, change = table.loc["rest"], table.loc["DLI"]
    assert change["area"] > 0.0 and change["F1"] > 0.0 and change["F2"] > 0.0
    opened = with_lips(
        ideal_vowel("u"),
        1e-6 * np.array([rest["area"], rest["area"] + 0.1 * change["area"]]),
        1e-3 * np.array([rest["protrusion"], rest["protrusion"] + 0.1 * change["protrusion"]]),
        np.arange(2.0),
    )
    F = with_formants(opened)["formant_frequency"].values
    assert 0.1 * change[["F1", "F2", "F3"]].values == pytest.approx((F[1] - F[0])[:3], abs=1e-3)


def written(path, position, triangle):
    """Write a surface in mm."""
    rows = [f"v {x} {y} {z}" for x, y, z in 1e3 * position]
    rows += [f"f {a} {b} {c}" for a, b, c in triangle + 1]
    path.write_text("\n".join(rows))
    return path


@pytest.mark.parametrize("count", [8, 12])
def test_a_line_without_an_end_reaches_the_other_open_rim(tmp_path, count):
    line = np.stack([np.linspace(0, 0.17, 601), np.zeros(601), np.zeros(601)], axis=1)
    path = written(tmp_path / "tube.obj", *pipe(line, 0.008, around=12))
    areas_read = areas_of_surface(path, (0.0, 0.0, 0.0), unit="mm", count=count)
    assert float(areas_read["length"][0]) == pytest.approx(0.17, rel=1e-9)


def test_the_area_function_of_a_surface_in_a_file(tmp_path):
    path = written(tmp_path / "tube.obj", *pipe(STRAIGHT, 0.008))
    areas_read = areas_of_surface(path, (0.0, 0.0, 0.0), unit="mm", count=20)
    assert areas_read["area"].values[0, 1:-1] == pytest.approx(np.pi * 0.008**2, rel=0.01)
    assert float(areas_read["length"][0]) == pytest.approx(0.17, rel=0.02)
    assert areas_read.attrs["origin"] == "measured"
    with pytest.raises(DataError, match="unknown unit 'inch'"):
        areas_of_surface(path, (0.0, 0.0, 0.0), unit="inch")


def test_sound_files_and_figures(tmp_path):
    tract = with_formants(ideal_vowel("a"))
    sound = synthesise(tract, "rosenberg", duration=0.1, rate=16_000)
    rate, samples = wavfile.read(write_wave(sound, tmp_path / "a.wav"))
    assert rate == 16_000 and samples.dtype == np.int16 and len(samples) == 1600
    assert np.abs(samples).max() == pytest.approx(0.9 * 32767, abs=1)
    pressure = samples / 32767 * sound.attrs["full_scale"]
    assert pressure == pytest.approx(sound["sound"].values, abs=1e-4 * sound.attrs["full_scale"])
    path = write_netcdf(sound, tmp_path / "a.nc", "sound")
    xr.testing.assert_allclose(read_netcdf(path, "sound")["sound"], sound["sound"])
    assert write_sound_figure(sound, tmp_path / "a.png", "a").stat().st_size > 10_000
    again = synthesise(tract, str(tmp_path / "a.wav"), duration=0.05)
    assert float(np.abs(again["sound"]).max()) > 0.0
    silent = synthesise(tract, "folds", duration=0.02, lung=0.0)
    assert not wavfile.read(write_wave(silent, tmp_path / "0.wav"))[1].any()
    with pytest.raises(AcousticsError, match="2 samples"):
        synthesise(tract, duration=0.0)


def test_closed_and_retracted_lips_have_a_faint_and_an_ordinary_sound(tmp_path):
    lips = np.zeros(2), np.array([0.0, -0.02]), np.array([0.0, 0.1])
    closed = synthesise(with_lips(ideal_vowel("a"), *lips))
    assert closed["length"].values == pytest.approx([0.17, 0.161])
    assert np.abs(wavfile.read(write_wave(closed, tmp_path / "c.wav"))[1]).max() < 0.1 * 32767


def test_unknown_sources_and_files_are_refused(tmp_path):
    given = {"lung": 785.0, "pitch": 100.0, "tension": 1.0}
    with pytest.raises(ConfigurationError, match="unknown source"):
        source_of("whistle", 0.1, **given)
    (tmp_path / "no.wav").write_text("no wave")
    with pytest.raises(DataError, match="wave file"):
        source_of(str(tmp_path / "no.wav"), 0.1, **given)
    still = area_function(np.full((1, 4), 1e-4), np.array([0.1]), np.zeros(1))
    with pytest.raises(ConfigurationError, match="suffix"):
        write_wave(still, tmp_path / "a.mp3")
